#include <broadcl/mpi.hpp>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "mpi/cross_pairs.hpp"
#include "mpi/exclusions.hpp"
#include "mpi/host_objects.hpp"
#include "mpi/ranks.hpp"
#include "mpi/stages.hpp"

namespace broadcl {

using namespace mpi;

class MpiBroadPhase::Impl {
 public:
  /// Does not communicate.
  Impl(const Config& config, std::size_t rank, std::size_t ranks)
      : objects_(config), cross_(config, rank, ranks) {}
  void join(Ranks&& ranks) noexcept { ranks_.emplace(std::move(ranks)); }

  [[nodiscard]] HostObjects& objects() noexcept { return objects_; }
  [[nodiscard]] const HostObjects& objects() const noexcept { return objects_; }
  [[nodiscard]] const CrossPairs& cross() const noexcept { return cross_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profile_; }

  void set_exclusions(std::span<const MpiPair> pairs) {
    Exclusions exclusions(pairs, ranks_->rank(), ranks_->count());
    objects_.set_exclusions(exclusions.own);
    // Nothing below throws.
    cross_.set_exclusions(std::move(exclusions.of_others));
  }

  MpiDelta update() {
    ranks_->together([&] {
      profile_.clear();
      stages_.begin();
    });
    cross_.restore(*ranks_);
    MpiDelta delta;
    try {
      cross_.update(*ranks_, objects_, stages_);
      ranks_->together([&] {
        delta.own = objects_.finish();
        stages_.end("finish");
        stages_.append_to(profile_, objects_.search().profile());
      });
    } catch (...) {
      objects_.abandon();
      throw;
    }
    // Nothing below throws.
    objects_.commit();
    cross_.commit();
    delta.added = cross_.added();
    delta.removed = cross_.removed();
    return delta;
  }

  std::vector<MpiPair> pairs() {
    cross_.restore(*ranks_);
    const std::vector<MpiPair> cross = cross_.pairs(*ranks_);
    std::vector<MpiPair> all;
    ranks_->together([&] {
      for (const auto& [a, b] : objects_.pairs()) {
        all.push_back({.a = mpi_id(ranks_->rank(), a), .b = mpi_id(ranks_->rank(), b)});
      }
      all.insert(all.end(), cross.begin(), cross.end());
    });
    return all;
  }

 private:
  std::optional<Ranks> ranks_;
  HostObjects objects_;
  CrossPairs cross_;
  Stages stages_;
  std::vector<Stage> profile_;
};

MpiBroadPhase::MpiBroadPhase(MPI_Comm comm, const Config& config) {
  Ranks ranks(comm);
  const std::size_t threads = ranks.threads(config.threads);
  ranks.together([&] {
    if (config.distance != 0)
      throw Error::invalid_argument("ranks search no distances; set Config::distance to 0");
    Config own = config;
    own.threads = threads;
    impl_ = std::make_unique<Impl>(own, static_cast<std::size_t>(ranks.rank()),
                                   static_cast<std::size_t>(ranks.count()));
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

void MpiBroadPhase::set_exclusions(std::span<const MpiPair> pairs) {
  impl_->set_exclusions(pairs);
}

void MpiBroadPhase::remove(std::uint32_t id) {
  impl_->objects().remove(id);
}

std::span<Aabb> MpiBroadPhase::map(std::size_t n) {
  return impl_->objects().map(n);
}

MpiDelta MpiBroadPhase::update() {
  return impl_->update();
}

std::vector<MpiPair> MpiBroadPhase::pairs() {
  return impl_->pairs();
}

std::size_t MpiBroadPhase::size() const noexcept {
  return impl_->objects().count();
}

const Device* MpiBroadPhase::device() const noexcept {
  return impl_->objects().search().algorithm().device();
}

MemoryUse MpiBroadPhase::memory() const noexcept {
  return impl_->cross().memory(impl_->objects().search().algorithm().memory());
}

std::span<const Stage> MpiBroadPhase::profile() const noexcept {
  return impl_->profile();
}

std::size_t MpiBroadPhase::bytes_sent() const noexcept {
  return impl_->cross().bytes_sent();
}

std::string mpi_device(MPI_Comm comm) {
  const Ranks ranks(comm);
  const Ranks::Node node = ranks.node();
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
    selector = gpus[static_cast<std::size_t>(node.rank) % gpus.size()].id();
  });
  return selector;
}

}  // namespace broadcl
