#include "mpi/device_objects.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/mpi_opencl.hpp>

#include <optional>
#include <utility>

#include "mpi/cross_pairs.hpp"
#include "mpi/exclusions.hpp"
#include "mpi/ranks.hpp"
#include "mpi/stages.hpp"

namespace broadcl {

using namespace mpi;

class MpiDeviceBroadPhase::Impl {
 public:
  /// Does not communicate.
  Impl(cl_command_queue queue, const MpiDeviceBroadPhase::Config& config, const Ranks& ranks,
       std::size_t threads)
      : objects_(make_device_core(queue, config), Threads({.threads = threads, .executor = config.executor})),
        cross_({.device = objects_.core().context().device().id(),
                .algorithm = config.algorithm,
                .threads = threads,
                .executor = config.executor},
               static_cast<std::size_t>(ranks.rank()), static_cast<std::size_t>(ranks.count())) {}
  void join(Ranks&& ranks) noexcept { ranks_.emplace(std::move(ranks)); }

  [[nodiscard]] const DeviceCore& core() const noexcept { return objects_.core(); }
  [[nodiscard]] const CrossPairs& cross() const noexcept { return cross_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profile_; }

  void set_exclusions(std::span<const MpiPair> pairs) {
    Exclusions exclusions(pairs, ranks_->rank(), ranks_->count());
    objects_.core().set_exclusions(exclusions.own);
    // Nothing below throws.
    cross_.set_exclusions(std::move(exclusions.of_others));
  }

  Result update(const Boxes& boxes) {
    ranks_->together([&] {
      objects_.set(boxes);
      profile_.clear();
      stages_.begin();
    });
    cross_.restore(*ranks_);
    try {
      cross_.update(*ranks_, objects_, stages_);
      ranks_->together([&] {
        objects_.core().complete();
        stages_.end("finish");
        stages_.append_to(profile_, core().profile());
      });
    } catch (...) {
      objects_.core().abandon();
      throw;
    }
    // Nothing below throws.
    cross_.commit();
    return {.own = objects_.core().commit(), .added = cross_.added(), .removed = cross_.removed()};
  }

  Pairs pairs() {
    cross_.restore(*ranks_);
    Pairs pairs{.own = {}, .with_others = cross_.pairs(*ranks_)};
    ranks_->together([&] { pairs.own = objects_.core().pairs(); });
    return pairs;
  }

 private:
  std::optional<Ranks> ranks_;
  DeviceObjects objects_;
  CrossPairs cross_;
  Stages stages_;
  std::vector<Stage> profile_;
};

MpiDeviceBroadPhase::MpiDeviceBroadPhase(MPI_Comm comm, cl_command_queue queue, const Config& config) {
  Ranks ranks(comm);
  const std::size_t threads = ranks.threads(config.threads);
  ranks.together([&] { impl_ = std::make_unique<Impl>(queue, config, ranks, threads); });
  impl_->join(std::move(ranks));
}
MpiDeviceBroadPhase::~MpiDeviceBroadPhase() = default;
MpiDeviceBroadPhase::MpiDeviceBroadPhase(MpiDeviceBroadPhase&&) noexcept = default;
MpiDeviceBroadPhase& MpiDeviceBroadPhase::operator=(MpiDeviceBroadPhase&&) noexcept = default;

void MpiDeviceBroadPhase::set_exclusions(std::span<const MpiPair> pairs) {
  impl_->set_exclusions(pairs);
}

MpiDeviceBroadPhase::Result MpiDeviceBroadPhase::update(const Boxes& boxes) {
  return impl_->update(boxes);
}

MpiDeviceBroadPhase::Pairs MpiDeviceBroadPhase::pairs() {
  return impl_->pairs();
}

const Device& MpiDeviceBroadPhase::device() const noexcept {
  return impl_->core().context().device();
}

MemoryUse MpiDeviceBroadPhase::memory() const noexcept {
  return impl_->cross().memory(impl_->core().memory());
}

std::span<const Stage> MpiDeviceBroadPhase::profile() const noexcept {
  return impl_->profile();
}

std::size_t MpiDeviceBroadPhase::bytes_sent() const noexcept {
  return impl_->cross().bytes_sent();
}

}  // namespace broadcl
