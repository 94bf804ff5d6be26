#include "engines/hybrid.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <future>
#include <new>
#include <optional>
#include <utility>

#include <broadcl/error.hpp>

#include "base/box_replacement.hpp"
#include "base/hysteresis.hpp"
#include "base/packed_box.hpp"
#include "base/pair_lists.hpp"
#include "base/thread_pool.hpp"
#include "engines/change_lists.hpp"
#include "opencl/process.hpp"

namespace broadcl {
namespace {

/// A device is opened once slow updates in a row have taken as long as this many of the fastest slow ones. A
/// switch must save at least as much, or a few slow updates could cause one.
constexpr double slow_updates_until_opening = 100;

/// The first search of all boxes takes so many times as long as a later one, because it also sorts and
/// allocates.
constexpr double first_search = 2;

/// Corrects the expected time of an update by the measured times of earlier ones: first by their mean, then
/// with less and less weight for old ones.
class Estimate {
 public:
  /// @returns The time taken, or the most that counts.
  double learn(double expected, double taken) noexcept {
    if (expected <= 0 || taken <= 0) return taken;  // the clock may be too coarse
    constexpr double most_samples = 1024;
    // An update or two that took longer had to wait, perhaps for a compiler.
    constexpr double most_growth = 4;
    last_ = std::min(taken / expected, most_growth * std::max(factor_, last_));
    samples_ = std::min(samples_ + 1, most_samples);
    factor_ += (last_ - factor_) / samples_;
    return last_ * expected;
  }
  [[nodiscard]] double seconds(double expected) const noexcept { return factor_ * expected; }

  /// To be called before a time without updates, after which new ones say more than old ones.
  void pause() noexcept {
    constexpr double most_samples = 8;
    samples_ = std::min(samples_, most_samples);
  }

 private:
  double factor_ = 1;
  double last_ = 1;  // of the last update
  double samples_ = 0;
};

/// The host or the device.
struct Side {
  AlgorithmPointer algorithm;
  Estimate estimate{};
  bool has_pairs = false;  // of an earlier update

  [[nodiscard]] double seconds(std::size_t slots, std::size_t changed) const {
    return estimate.seconds(algorithm->expected_seconds(slots, changed));
  }
};

/// Opens a device in a thread of its own, at most once, when updates on the host have been slow for long
/// enough.
class Opening {
 public:
  Opening(OpenDevice open, double slow_update) : open_(std::move(open)), slow_update_(slow_update) {}

  /// Seconds of slow updates that are long enough.
  [[nodiscard]] double long_enough() const noexcept { return slow_updates_until_opening * slow_update_; }
  /// Whether the thread runs, which slows updates down.
  [[nodiscard]] bool is_running() const noexcept { return result_ != nullptr; }

  /// @param taken The seconds of an update on the host.
  /// @param prepare What to do with the device in that thread, once it is open.
  /// @throws std::bad_alloc, std::system_error
  void count(double taken, const std::function<void(Algorithm&)>& prepare) {
    const double excess = taken > slow_update_ ? taken : -long_enough();
    if (!rule_.must_change(excess, long_enough()) || open_ == nullptr) return;
    opencl::use_in_this_process();  // before a process can be forked without the thread
    const auto work = [open = open_, prepare] {
      const BackgroundWork background;
      AlgorithmPointer device = open();
      if (device != nullptr) prepare(*device);
      return device;
    };
    result_ = Result(new std::future(std::async(std::launch::async, work)));
    open_ = nullptr;
  }

  /// @returns The device once it is open. Null before, afterwards, and if there is none.
  /// @throws Error, std::bad_alloc, or what the user's function throws, if it could not be opened.
  AlgorithmPointer take() {
    if (!is_running() || result_->wait_for(std::chrono::seconds(0)) != std::future_status::ready)
      return nullptr;
    const Result ready = std::move(result_);
    return ready->get();
  }

 private:
  /// Its destructor waits for the thread, which a process that was forked does not have.
  using Result = std::unique_ptr<std::future<AlgorithmPointer>, opencl::DeleteUnlessForked>;

  OpenDevice open_;  // until it is called
  Result result_;
  double slow_update_;  // seconds
  Hysteresis rule_;
};

/// The last update was done on one side, the next one is done on the other. It must search all boxes there,
/// and what changed follows from the pairs of the first side.
using Handover = std::optional<std::vector<Pair>>;

class Hybrid final : public Algorithm {
 public:
  Hybrid(AlgorithmPointer host, OpenDevice open, double slow_update, const Threads& threads, Now now)
      : host_{std::move(host)},
        opening_(std::move(open), slow_update),
        now_(std::move(now)),
        parts_(threads) {}

  void reserve(std::size_t slots, bool filters) override {
    or_leave_device([&] { current().reserve(slots, filters); });
    filters_ = filters || filters_;
  }

  void reserve_exclusions(std::size_t count) override {
    or_leave_device([&] { current().reserve_exclusions(count); });
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return current().boxes(); }
  [[nodiscard]] std::span<Aabb> spare_boxes() override {
    std::span<Aabb> boxes;
    or_leave_device([&] { boxes = current().spare_boxes(); });
    has_spare_ = true;
    return boxes;
  }
  void swap_boxes() noexcept override { current().swap_boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return current().boxes_owner(); }

  [[nodiscard]] bool uploads_boxes() const noexcept override { return current().uploads_boxes(); }

  void begin(const Input& input) override {
    if (failure_ != nullptr) std::rethrow_exception(std::exchange(failure_, nullptr));
    input_ = input;
    Input own = input;
    if (handover_) {
      own.changed = {.all = true};
      own.unread = nullptr;
      own.rules.all_changed = true;
    }
    begin_seconds_ = 0;  // on the host, which does its work in finish()
    if (!is_on_device()) return current().begin(own);
    const auto start = now_();
    or_leave_device([&] {
      try {
        current().begin(own);
      } catch (...) {
        if (own.arriving != nullptr) own.arriving->stop();  // boxes are copied if the device is left
        throw;
      }
    });
    begin_seconds_ = seconds_since(start);
  }

  void flush() override {
    or_leave_device([&] { current().flush(); });
  }

  Delta finish() override {
    const auto start = now_();
    Delta delta;
    std::vector<Pair> pairs;
    bool had_pairs = false;
    or_leave_device([&] {
      delta = current().finish();
      had_pairs = std::exchange(side_->has_pairs, true);
      if (handover_ && had_pairs) pairs = current().pairs();
    });
    std::optional<double> taken;
    if (handover_) {
      delta = lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
        const std::span<const Pair> now = had_pairs ? pairs : delta.added;
        compare(*handover_, now, input_.changed.recycled, parts_, added, removed);
      });
      parts_.free_scratch();
    } else if (was_updated_ && !opening_.is_running()) {  // the first update of all boxes takes longer
      taken = side_->estimate.learn(current().expected_seconds(input_.boxes.size(), changed_slots()),
                                    begin_seconds_ + seconds_since(start));
    }
    // Nothing below throws.
    lists_.commit();
    handover_.reset();
    asked_ = &current();
    failed_.reset();
    if (std::exchange(was_updated_, true)) choose(taken);  // a program with a single update needs no device
    return delta;
  }

  void shrink(std::size_t slots) override {
    or_leave_device([&] { current().shrink(slots); });
    filters_ = has_spare_ = false;
    lists_.clear();
    if (handover_) handover_->shrink_to_fit();
    if (device_.algorithm == nullptr || opencl::is_forked()) return;
    Side& idle = other();
    idle.algorithm->begin(
        {.changed = {.all = true}, .rules = {.all_changed = true}});  // no objects, so that it knows no pairs
    (void)idle.algorithm->finish();
    idle.has_pairs = false;
    idle.algorithm->shrink(0);
  }

  [[nodiscard]] std::vector<Pair> find_all(const Input& input) override { return current().find_all(input); }

  [[nodiscard]] BoxTree* tree() noexcept override { return handover_ ? nullptr : current().tree(); }
  void read(const Input& input) override { current().read(input); }

  [[nodiscard]] Touching touching(AxisSet axes) override {
    Touching touching;
    or_leave_device([&] { touching = asked_->touching(axes); });
    return touching;
  }

  [[nodiscard]] std::vector<Pair> pairs() override { return handover_ ? *handover_ : current().pairs(); }

  [[nodiscard]] const Device* device() const noexcept override { return side_->algorithm->device(); }
  [[nodiscard]] MemoryUse memory() const noexcept override {
    const AlgorithmPointer& device = failed_ != nullptr ? failed_ : device_.algorithm;
    return device != nullptr ? device->memory() : MemoryUse();
  }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return asked_->profile(); }

 private:
  [[nodiscard]] double seconds_since(std::chrono::steady_clock::time_point start) const {
    return std::chrono::duration<double>(now_() - start).count();
  }

  [[nodiscard]] Algorithm& current() const noexcept { return *side_->algorithm; }
  [[nodiscard]] bool is_on_device() const noexcept { return side_ == &device_; }
  [[nodiscard]] Side& other() noexcept { return is_on_device() ? host_ : device_; }

  [[nodiscard]] std::size_t changed_slots() const noexcept {
    return input_.changed.all ? input_.boxes.size() : input_.changed.slots.size();
  }

  /// Does something that may fail on the device: what follows is then done on the host, for good, if the
  /// device still knows the pairs.
  template <class Function>
  void or_leave_device(const Function& function) {
    try {
      function();
    } catch (const Error&) {
      if (is_on_device()) leave_device();
      throw;
    }
  }

  void leave_device() noexcept try {
    hand_over();
    failed_ = std::move(device_.algorithm);
  } catch (...) {
    // The next update is done on the device again.
  }

  /// Allocates memory, which takes several times as long as an update.
  static void prepare(Algorithm& device, std::size_t slots, bool filters, bool spare) {
    try {
      device.reserve(slots, filters);
      if (spare) (void)device.spare_boxes();
    } catch (const Error&) {  // it may have enough memory later, when it is to be used
    } catch (const std::bad_alloc&) {
    }
  }

  /// @throws Error, std::bad_alloc; nothing has changed then.
  void hand_over() {
    Handover pairs;
    if (!handover_) pairs = current().pairs();
    Algorithm& next = *other().algorithm;
    const std::span<const Aabb> boxes = current().boxes();
    next.reserve(boxes.size(), filters_);
    const auto copy = [](std::span<const Aabb> from, std::span<Aabb> to) {
      std::fill(std::ranges::copy(from, to.begin()).out, to.end(), packed_empty());
    };
    if (has_spare_) copy(current().spare_boxes(), next.spare_boxes());
    copy(boxes, next.boxes());
    side_ = &other();
    if (pairs) handover_ = std::move(pairs);
  }

  /// Decides which side does the next update. A switch costs a search of all boxes there, and later perhaps
  /// another one here, and must save as much as the slow updates that open a device.
  /// @param taken The seconds of the last update, if that says what later ones take.
  void choose(std::optional<double> taken) noexcept try {
    if (opencl::is_forked()) return;
    if (device_.algorithm == nullptr) take_opened();
    if (!taken) return;
    if (device_.algorithm == nullptr) {
      return opening_.count(
          *taken, [slots = current().boxes().size(), filters = filters_,
                   spare = has_spare_](Algorithm& device) { prepare(device, slots, filters, spare); });
    }
    const std::size_t slots = input_.boxes.size();
    const double there_and_back =
        first_search * (host_.seconds(slots, slots) + device_.seconds(slots, slots));
    const double excess = *taken - other().seconds(slots, changed_slots());
    if (!rule_.must_change(excess, std::max(there_and_back, opening_.long_enough()))) return;
    hand_over();
    other().estimate.pause();
  } catch (...) {
    // The next update is done where the last one was.
  }

  void take_opened() try { device_.algorithm = opening_.take(); } catch (const Error&) {
    failure_ = std::current_exception();
  } catch (const std::bad_alloc&) {
    failure_ = std::current_exception();
  }

  Side host_;
  Side device_{};        // without an algorithm until it is open, and after it has failed
  Side* side_ = &host_;  // does the next update
  Opening opening_;
  std::exception_ptr failure_;  // of opening, for the next update
  Now now_;
  bool filters_ = false;    // whether there is memory for filters
  bool has_spare_ = false;  // and for spare boxes
  bool was_updated_ = false;
  Input input_;                               // of the last update
  double begin_seconds_ = 0;                  // that begin() of the last update took
  Hysteresis rule_;                           // that chooses the side
  Handover handover_;                         // if the next update is the first on its side
  Algorithm* asked_ = host_.algorithm.get();  // did the last update
  AlgorithmPointer failed_;                   // the device, if it did that one and then failed
  PairParts parts_;                           // of an update after a handover
  ChangeLists lists_;                         // and its changes
};

}  // namespace

AlgorithmPointer make_hybrid(AlgorithmPointer host, OpenDevice open, double slow_update,
                             const Threads& threads, Now now) {
  return std::make_unique<Hybrid>(std::move(host), std::move(open), slow_update, threads, std::move(now));
}

}  // namespace broadcl
