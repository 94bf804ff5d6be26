#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>

#include "engines/algorithm.hpp"
#include "engines/device_objects.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// What the algorithms on a device have in common. Each makes `objects_`, in frames of its own.
class OnDevice : public Algorithm {
 public:
  void reserve(std::size_t slots, bool filters) final {
    context_.guard([&] { objects_->reserve(slots, filters); });
  }
  void reserve_exclusions(std::size_t count) final {
    context_.guard([&] { objects_->reserve_exclusions(count); });
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept final { return objects_->boxes(); }
  [[nodiscard]] std::span<Aabb> spare_boxes() final {
    return context_.guard([&] { return objects_->spare_boxes(); });
  }
  void swap_boxes() noexcept final { objects_->swap_boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const final { return objects_->boxes_owner(); }

  void flush() final {
    context_.guard([&] { context_.queue().flush(); });
  }

  [[nodiscard]] const Device* device() const noexcept final { return &context_.device(); }
  [[nodiscard]] MemoryUse memory() const noexcept final { return context_.memory(); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept final { return profiler_.stages(); }

 protected:
  OnDevice(const Config& config, const Device& device, std::optional<opencl::Tuning> tuning = std::nullopt)
      : context_(device, config.profile, config.on_compile, tuning), profiler_(config.profile) {}

  opencl::Context context_;
  opencl::Profiler profiler_;
  std::unique_ptr<DeviceObjects> objects_;
};

}  // namespace broadcl
