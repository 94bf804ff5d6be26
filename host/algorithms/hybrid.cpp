#include "algorithms/hybrid.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <future>
#include <new>
#include <optional>
#include <utility>

#include <broadcl/error.hpp>

#include "algorithms/change_lists.hpp"
#include "free_lists.hpp"
#include "opencl/process.hpp"
#include "pair_lists.hpp"

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

/// A rough estimate of the time of an update on the host. It does not know how many boxes overlap, which can
/// change the time several times over.
double host_seconds(std::size_t slots, std::size_t changed) {
  return 5e-6 + std::min(600e-9 * static_cast<double>(changed), 150e-9 * static_cast<double>(slots));
}

class Hybrid final : public Algorithm {
  /// Its destructor waits for the thread, which a process that was forked does not have.
  using Opening = std::unique_ptr<std::future<AlgorithmPointer>, opencl::DeleteUnlessForked>;

 public:
  Hybrid(AlgorithmPointer host, OpenDevice open, double slow_update, Now now)
      : host_(std::move(host)), open_(std::move(open)), now_(std::move(now)), slow_update_(slow_update) {}

  void reserve(std::size_t slots, bool filters) override {
    or_leave_device([&] { current_->reserve(slots, filters); });
    filters_ = filters || filters_;
  }

  void reserve_exclusions(std::size_t count) override {
    or_leave_device([&] { current_->reserve_exclusions(count); });
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return current_->boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return current_->boxes_owner(); }

  void begin(const Changes& changes) override {
    if (failure_ != nullptr) std::rethrow_exception(std::exchange(failure_, nullptr));
    changes_ = changes;
    Changes own = changes;
    if (has_changed_) {
      own.all = own.all_filters = true;
      own.changed = own.recycled = own.refiltered = {};
    }
    seconds_ = 0;  // on the host, which does its work in finish()
    if (!is_on_device()) return current_->begin(own);
    const auto start = now_();
    or_leave_device([&] { current_->begin(own); });
    seconds_ = seconds_since(start);
  }

  void flush() override {
    or_leave_device([&] { current_->flush(); });
  }

  Delta finish() override {
    const auto start = now_();
    taken_.reset();
    Delta delta;
    std::vector<Pair> pairs;
    or_leave_device([&] {
      delta = current_->finish();
      if (has_changed_) pairs = current_->pairs();
    });
    if (has_changed_) {
      delta = lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
        compare(before_, pairs, changes_.recycled, added, removed);
      });
    } else if (was_updated_) {  // the first update of all boxes takes longer
      learn(seconds_ + seconds_since(start));
    }
    // Nothing below throws.
    lists_.commit();
    has_changed_ = false;
    free_lists(before_);
    asked_ = current_;
    if (has_device_failed_) device_.reset();
    if (std::exchange(was_updated_, true)) choose();  // a program with a single update needs no device
    return delta;
  }

  void shrink(std::size_t slots) override {
    or_leave_device([&] { current_->shrink(slots); });
    filters_ = false;
    lists_.clear();
    before_.shrink_to_fit();
    if (device_ == nullptr || has_device_failed_ || opencl::is_forked()) return;
    Algorithm& idle = is_on_device() ? *host_ : *device_;
    idle.begin({.all = true, .all_filters = true});  // no objects, so that it knows no pairs
    (void)idle.finish();
    idle.shrink(0);
  }

  [[nodiscard]] std::vector<Pair> find_all(const Changes& changes) override {
    return current_->find_all(changes);
  }

  [[nodiscard]] std::vector<Pair> pairs() override { return has_changed_ ? before_ : current_->pairs(); }

  [[nodiscard]] const Device* device() const noexcept override { return current_->device(); }
  [[nodiscard]] MemoryUse memory() const noexcept override {
    return device_ != nullptr ? device_->memory() : MemoryUse();
  }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return asked_->profile(); }

 private:
  [[nodiscard]] double seconds_since(std::chrono::steady_clock::time_point start) const {
    return std::chrono::duration<double>(now_() - start).count();
  }

  [[nodiscard]] bool is_on_device() const noexcept { return current_ == device_.get(); }

  [[nodiscard]] double seconds_on_host(std::size_t slots, std::size_t changed) const {
    return host_estimate_.seconds(host_seconds(slots, changed));
  }
  [[nodiscard]] double seconds_on_device(std::size_t slots, std::size_t changed) const {
    return device_estimate_.seconds(device_->expected_seconds(slots, changed));
  }

  [[nodiscard]] std::size_t changed_slots() const noexcept {
    return changes_.all ? changes_.slots : changes_.changed.size();
  }

  void learn(double taken) {
    if (opening_ != nullptr) return;  // which slows updates down
    const std::size_t changed = changed_slots();
    taken_ = is_on_device()
                 ? device_estimate_.learn(device_->expected_seconds(changes_.slots, changed), taken)
                 : host_estimate_.learn(host_seconds(changes_.slots, changed), taken);
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
    if (!has_changed_) before_ = current_->pairs();
    change_to(*host_);
    has_changed_ = has_device_failed_ = true;
  } catch (...) {
    // The next update is done on the device again.
  }

  /// Decides which side does the next update. A switch costs a search of all boxes on the other side, so it
  /// is made once staying has cost as much as going there and back (see "An optimal on-line algorithm for
  /// metrical task systems", Borodin, Linial and Saks, 1992), and as much as the slow updates that open a
  /// device.
  void choose() noexcept try {
    if (has_device_failed_ || opencl::is_forked()) return;
    take_opened();
    if (!taken_) return;
    const double long_enough = slow_updates_until_opening * slow_update_;
    if (device_ == nullptr) {
      slow_seconds_ = *taken_ > slow_update_ ? slow_seconds_ + *taken_ : 0;
      if (slow_seconds_ < long_enough || open_ == nullptr) return;
      opencl::use_in_this_process();  // before a process can be forked without the thread
      opening_ = Opening(new std::future(std::async(std::launch::async, open_)));
      open_ = nullptr;
      return;
    }
    const double other = is_on_device() ? seconds_on_host(changes_.slots, changed_slots())
                                        : seconds_on_device(changes_.slots, changed_slots());
    overspent_ = std::max(0.0, overspent_ + *taken_ - other);
    const double there_and_back = first_search * (seconds_on_host(changes_.slots, changes_.slots) +
                                                  seconds_on_device(changes_.slots, changes_.slots));
    if (overspent_ <= std::max(there_and_back, long_enough)) return;
    overspent_ = 0;
    before_ = current_->pairs();
    (is_on_device() ? device_estimate_ : host_estimate_).pause();
    change_to(is_on_device() ? *host_ : *device_);
    has_changed_ = true;
  } catch (...) {
    free_lists(before_);
    // The next update is done where the last one was.
  }

  void take_opened() try {
    if (opening_ == nullptr || opening_->wait_for(std::chrono::seconds(0)) != std::future_status::ready)
      return;
    const Opening opened = std::move(opening_);
    device_ = opened->get();
  } catch (const Error&) {
    failure_ = std::current_exception();
  } catch (const std::bad_alloc&) {
    failure_ = std::current_exception();
  }

  void change_to(Algorithm& next) {
    const std::span<const Aabb> boxes = current_->boxes();
    next.reserve(boxes.size(), filters_);
    std::ranges::copy(boxes, next.boxes().begin());
    current_ = &next;
  }

  AlgorithmPointer host_;
  AlgorithmPointer device_;  // if it was opened
  OpenDevice open_;          // until it is opened
  Now now_;
  Opening opening_;                   // null if it has not begun or has ended
  std::exception_ptr failure_;        // of opening it, for the next update
  Algorithm* current_ = host_.get();  // does the next update
  Algorithm* asked_ = host_.get();    // did the last one
  bool filters_ = false;              // whether there is memory for filters
  bool was_updated_ = false;
  Changes changes_;              // of the last update
  double seconds_ = 0;           // that begin() of the last update took
  std::optional<double> taken_;  // seconds that all of it took, if that says what later ones take
  Estimate host_estimate_, device_estimate_;
  double slow_update_;        // seconds
  double slow_seconds_ = 0;   // that slow updates in a row have taken on the host
  double overspent_ = 0;      // seconds that the other one would have saved
  bool has_changed_ = false;  // and the current one was not asked since then
  std::vector<Pair> before_;  // the pairs until then
  ChangeLists lists_;         // the changes since then
  bool has_device_failed_ = false;
};

}  // namespace

AlgorithmPointer make_hybrid(AlgorithmPointer host, OpenDevice open, double slow_update, Now now) {
  return std::make_unique<Hybrid>(std::move(host), std::move(open), slow_update, std::move(now));
}

}  // namespace broadcl
