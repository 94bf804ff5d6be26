#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <broadcl/mpi.hpp>

#include "base/packed_box.hpp"
#include "mpi/cuts.hpp"
#include "mpi/messages.hpp"
#include "mpi/objects.hpp"
#include "mpi/ranks.hpp"
#include "mpi/region.hpp"
#include "mpi/report.hpp"
#include "mpi/routes.hpp"
#include "mpi/workers.hpp"

namespace broadcl {

using namespace mpi;

namespace {

/// Number of points that each rank contributes when space is divided.
constexpr std::size_t samples_per_rank = 4096;

/// Space is divided again if a region has this many times the mean work.
constexpr double most_imbalance = 1.25;

/// If that does not help, it is tried again after at most this many updates.
constexpr std::size_t most_patience = 1024;

/// Of an update, including those that set up the search again, but without those of the region's broad phase.
constexpr std::size_t most_stages = 16;

/// What each rank sends to all others before an update.
struct Condition {
  std::uint64_t objects;
  std::uint64_t last_objects;  ///< At the last update.
  std::uint64_t boxes;         ///< In its region.
  std::uint64_t pairs;         ///< There.
  bool is_lost;                ///< What its region has is unknown, or too small.

  [[nodiscard]] double work() const { return static_cast<double>(boxes) + static_cast<double>(pairs); }
};

}  // namespace

class MpiBroadPhase::Impl {
 public:
  /// Does not communicate.
  Impl(std::size_t rank, std::size_t ranks, const Config& config)
      : workers_(config.threads),
        objects_(workers_),
        cuts_(ranks, {}),
        next_cuts_(cuts_),
        region_(config, ranks, workers_),
        routes_(rank, ranks, workers_),
        report_(rank, ranks, workers_) {
    profile_.reserve(most_stages);
  }
  void join(Ranks&& ranks) noexcept { ranks_.emplace(std::move(ranks)); }

  /// The objects, to be changed.
  [[nodiscard]] Objects& objects() noexcept {
    objects_.take_back(region_.mapped());
    return objects_;
  }
  [[nodiscard]] std::size_t size() const noexcept { return objects_.size(); }

  /// If the region's own slots are exactly these objects, their boxes are written directly to the region.
  std::span<Aabb> map(std::size_t n) {
    if (is_lost_ || n > region_.base() || !objects_.can_be_lent(n)) return objects().map(n);
    const std::span<Aabb> boxes = region_.map().first(n);
    // Nothing below throws.
    routes_.write_absent(objects_.now(), boxes);
    objects_.lend();
    return boxes;
  }

  [[nodiscard]] const BroadPhase& broad_phase() const noexcept { return region_.broad_phase(); }
  [[nodiscard]] const Cuts& cuts() const noexcept { return cuts_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profile_; }
  [[nodiscard]] std::size_t bytes_sent() const noexcept { return bytes_sent_; }

  MpiDelta update() {
    start();
    const std::vector<Condition> conditions = ranks_->gather(condition());
    end_stage("agree");
    prepare(conditions);
    is_lost_ = true;  // until all of this is done
    const bool is_cut = is_off_balance(conditions);
    if (is_cut) {
      objects_.take_back(region_.mapped());
      divide(conditions);
    } else {
      next_cuts_ = cuts_;
    }
    const MpiDelta delta = step(Routes::To::now, is_cut);
    // Nothing below throws.
    std::swap(cuts_, next_cuts_);
    routes_.commit();
    region_.commit();
    objects_.commit();
    is_lost_ = false;
    return delta;
  }

  std::vector<MpiPair> pairs() {
    start();
    prepare(ranks_->gather(condition()));
    ranks_->together([&] {
      report_.sift(region_.pairs(), Report::Of::all, cuts_, objects_, region_, routes_);
      report_.sift({}, Report::Of::removed, cuts_, objects_, region_, routes_);
      report_.write(out_);
    });
    ranks_->exchange(out_, in_);
    std::vector<MpiPair> pairs;
    std::vector<MpiPair> none;
    ranks_->together([&] { (void)report_.collect(in_, pairs, none); });
    return pairs;
  }

 private:
  using Clock = std::chrono::steady_clock;

  [[nodiscard]] std::size_t count() const noexcept { return static_cast<std::size_t>(ranks_->count()); }

  [[nodiscard]] Condition condition() const noexcept {
    return {.objects = objects_.size(),
            .last_objects = objects_.last_size(),
            .boxes = routes_.here_count() + region_.guests(),
            .pairs = region_.pair_count(),
            .is_lost = is_lost_ || objects_.ids() > region_.base()};
  }

  /// If the state of a rank's region is unknown, all regions are filled again with the state of the last
  /// update.
  void prepare(const std::vector<Condition>& conditions) {
    if (std::ranges::none_of(conditions, &Condition::is_lost)) return;
    is_lost_ = true;
    ranks_->together([&] {
      objects_.take_back(region_.mapped());
      routes_.clear();
      region_.clear(objects_.ids());
    });
    const auto had_objects = [](const Condition& condition) { return condition.last_objects > 0; };
    if (std::ranges::any_of(conditions, had_objects)) {
      next_cuts_ = cuts_;
      (void)step(Routes::To::last, true);
      // Nothing below throws.
      routes_.commit();
      region_.commit();
    }
    is_lost_ = false;
  }

  [[nodiscard]] bool is_off_balance(const std::vector<Condition>& conditions) {
    std::uint64_t objects = 0;
    double most = 0;
    double sum = 0;
    for (const Condition& condition : conditions) {
      objects += condition.objects;
      most = std::max(most, condition.work());
      sum += condition.work();
    }
    if (count() == 1 || objects == 0) return false;
    if (!std::exchange(is_divided_, true)) return true;
    if (most * static_cast<double>(count()) <= most_imbalance * sum) {
      patience_ = 1;
      wait_ = 0;
      return false;
    }
    if (wait_ > 0) {
      --wait_;
      return false;
    }
    wait_ = patience_;
    patience_ = std::min(2 * patience_, most_patience);
    return true;
  }

  /// Divides space into regions of about the same work, which is the number of boxes and pairs; pairs are
  /// assumed to be distributed evenly over the boxes of a region.
  void divide(const std::vector<Condition>& conditions) {
    std::vector<Sample> own;
    ranks_->together([&] { own = sample(conditions); });
    std::vector<Sample> all = ranks_->gather_all(std::span<const Sample>(own));
    ranks_->together([&] { next_cuts_ = Cuts(count(), std::move(all)); });
    end_stage("divide");
  }

  [[nodiscard]] std::vector<Sample> sample(const std::vector<Condition>& conditions) const {
    const std::span<const Aabb> boxes = objects_.now();
    const std::size_t stride = boxes.size() / samples_per_rank + 1;
    std::vector<Sample> sample;
    for (std::size_t id = 0; id < boxes.size(); id += stride) {
      const Aabb& box = boxes[id];
      if (!is_proper(box)) continue;
      const Condition& around = conditions[cuts_.region_of(box.lower)];
      const double work = around.boxes == 0 ? 1 : around.work() / static_cast<double>(around.boxes);
      sample.push_back(
          {.point = box.lower, .weight = static_cast<float>(work * static_cast<double>(stride))});
    }
    return sample;
  }

  /// Updates all regions, from the state of the last update to the current one, and finds what changed; or
  /// fills empty regions with the state of the last update.
  MpiDelta step(Routes::To to, bool all) {
    bool is_in_place = false;
    ranks_->together([&] { is_in_place = routes_.route(objects_, next_cuts_, to, all, region_, out_); });
    end_stage("route");
    send(in_);
    end_stage("send");
    ranks_->together([&] {
      region_.receive(in_, is_in_place);
      search(to);
    });
    MpiDelta delta;
    if (to == Routes::To::last) return delta;
    send(pairs_in_);
    end_stage("return");
    ranks_->together([&] { delta = report_.collect(pairs_in_, added_, removed_); });
    end_stage("collect");
    return delta;
  }

  void send(std::vector<Bytes>& in) {
    ranks_->exchange(out_, in);
    for (const Bytes& message : out_) bytes_sent_ += message.size();
  }

  void search(Routes::To to) {
    const bool is_now = to == Routes::To::now;
    const std::chrono::duration<double> before = stage_start_ - update_start_;
    const Delta delta = region_.search([&] {
      if (is_now) objects_.take_back(region_.mapped());
    });
    const std::span<const Stage> stages = region_.broad_phase().profile();
    profile_.reserve(profile_.size() + stages.size() + most_stages);
    for (Stage stage : stages) {
      stage.host_start += before.count();
      profile_.push_back(stage);
    }
    end_stage("search");
    if (!is_now) return;
    report_.sift(delta.added, Report::Of::added, next_cuts_, objects_, region_, routes_);
    report_.sift(delta.removed, Report::Of::removed, cuts_, objects_, region_, routes_);
    report_.write(out_);
    end_stage("report");
  }

  void start() noexcept {
    profile_.clear();
    bytes_sent_ = 0;
    update_start_ = stage_start_ = Clock::now();
  }
  void end_stage(std::string_view name) {
    const Clock::time_point now = Clock::now();
    const std::chrono::duration<double> before = stage_start_ - update_start_;
    const std::chrono::duration<double> taken = now - stage_start_;
    profile_.push_back({.name = name,  // within its capacity
                        .host_start = before.count(),
                        .host_seconds = taken.count(),
                        .device_start = 0,
                        .device_seconds = 0});
    stage_start_ = now;
  }

  std::optional<Ranks> ranks_;
  Workers workers_;
  Objects objects_;
  Cuts cuts_;       // of the last update
  Cuts next_cuts_;  // of the one that is under way
  Region region_;
  Routes routes_;
  Report report_;
  bool is_lost_ = false;  // an update has failed in the midst
  bool is_divided_ = false;
  std::size_t patience_ = 1;  // updates to wait if cutting does not help
  std::size_t wait_ = 0;      // updates until regions may be cut again

  std::vector<Bytes> out_, in_, pairs_in_;  // messages, by rank
  std::vector<MpiPair> added_, removed_;    // memory of the last lists
  std::vector<Stage> profile_;
  std::size_t bytes_sent_ = 0;
  Clock::time_point update_start_, stage_start_;
};

MpiBroadPhase::MpiBroadPhase(MPI_Comm comm, const Config& config) {
  Ranks ranks(comm);
  const Ranks::Host host = ranks.host();
  ranks.together([&] {
    Config own = config;
    if (own.threads == 0) {
      own.threads = std::max(1U, std::thread::hardware_concurrency() / static_cast<unsigned>(host.ranks));
    }
    impl_ = std::make_unique<Impl>(static_cast<std::size_t>(ranks.rank()),
                                   static_cast<std::size_t>(ranks.count()), own);
  });
  impl_->join(std::move(ranks));
}
MpiBroadPhase::~MpiBroadPhase() = default;
MpiBroadPhase::MpiBroadPhase(MpiBroadPhase&&) noexcept = default;
MpiBroadPhase& MpiBroadPhase::operator=(MpiBroadPhase&&) noexcept = default;

std::uint32_t MpiBroadPhase::add(const Aabb& box, const Filter& filter) {
  return impl_->objects().add(box, filter);
}

void MpiBroadPhase::move(std::uint32_t id, const Aabb& box) {
  impl_->objects().move(id, box);
}

void MpiBroadPhase::set_filter(std::uint32_t id, const Filter& filter) {
  impl_->objects().set_filter(id, filter);
}

void MpiBroadPhase::remove(std::uint32_t id) {
  impl_->objects().remove(id);
}

std::span<Aabb> MpiBroadPhase::map(std::size_t n) {
  return impl_->map(n);
}

MpiDelta MpiBroadPhase::update() {
  return impl_->update();
}

std::vector<MpiPair> MpiBroadPhase::pairs() {
  return impl_->pairs();
}

std::size_t MpiBroadPhase::size() const noexcept {
  return impl_->size();
}

int MpiBroadPhase::region_of(const std::array<float, 3>& point) const noexcept {
  return static_cast<int>(impl_->cuts().region_of(point));
}

const Device* MpiBroadPhase::device() const noexcept {
  return impl_->broad_phase().device();
}

MemoryUse MpiBroadPhase::memory() const noexcept {
  return impl_->broad_phase().memory();
}

std::span<const Stage> MpiBroadPhase::profile() const noexcept {
  return impl_->profile();
}

std::size_t MpiBroadPhase::bytes_sent() const noexcept {
  return impl_->bytes_sent();
}

std::string mpi_device(MPI_Comm comm) {
  const Ranks ranks(comm);
  const Ranks::Host host = ranks.host();
  std::string selector;
  ranks.together([&] {
    const char* named = std::getenv("BROADCL_DEVICE");  // NOLINT(concurrency-mt-unsafe)
    if (named != nullptr && *named != '\0') return;
    const std::vector<Device> all = devices();
    if (std::ranges::none_of(all, [](const Device& device) { return device.type == DeviceType::gpu; }))
      return;
    const unsigned platform = select_device("gpu", all).platform;
    std::vector<Device> gpus;
    std::ranges::copy_if(all, std::back_inserter(gpus), [&](const Device& device) {
      return device.type == DeviceType::gpu && device.platform == platform;
    });
    selector = gpus[static_cast<std::size_t>(host.rank) % gpus.size()].id();
  });
  return selector;
}

}  // namespace broadcl
