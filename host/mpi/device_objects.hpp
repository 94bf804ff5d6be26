#pragma once

#include "base/threads.hpp"
#include "core/device_core.hpp"  // before <CL/cl.h>: it chooses the version

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/opencl.hpp>

#include "engines/boxes_outside.hpp"
#include "mpi/bounds.hpp"
#include "mpi/halos.hpp"
#include "mpi/objects.hpp"

namespace broadcl::mpi {

/// The objects of a rank in a DeviceCore, which finds the pairs among them.
class DeviceObjects final : public Objects {
 public:
  /// @param threads At most.
  DeviceObjects(DeviceCorePointer core, Threads threads)
      : core_(std::move(core)), threads_(std::move(threads)), outside_(core_->context()) {}

  /// Sets the objects of the next update.
  /// @throws Error if the device cannot use them; they are then as before.
  void set(const DeviceBroadPhase::Boxes& boxes);
  [[nodiscard]] DeviceCore& core() noexcept { return *core_; }
  [[nodiscard]] const DeviceCore& core() const noexcept { return *core_; }

  [[nodiscard]] bool begin(const OwnBounds* own, const Neighbours& neighbours,
                           std::vector<Halo>& near) override;
  [[nodiscard]] std::size_t count() const override { return source_.count; }
  [[nodiscard]] std::span<const Aabb> boxes() override;
  [[nodiscard]] std::span<const Filter> filters() override;
  [[nodiscard]] bool have_all_changed() const override { return true; }
  [[nodiscard]] std::span<const std::uint32_t> changed() const override { return {}; }
  [[nodiscard]] std::span<const std::uint32_t> recycled() const override { return {}; }

 private:
  DeviceCorePointer core_;
  Threads threads_;
  BoxesOutside outside_;
  DeviceBroadPhase::Boxes source_;
  // Copies of them, if there are any.
  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
};

}  // namespace broadcl::mpi
