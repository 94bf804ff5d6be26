#include "core/device_core.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/opencl.hpp>

#include <memory>

namespace broadcl {

class DeviceBroadPhase::Impl {
 public:
  Impl(cl_command_queue queue, const Config& config) : core(make_device_core(queue, config)) {}

  DeviceCorePointer core;
};

DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue) : DeviceBroadPhase(queue, Config()) {}
DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue, const Config& config)
    : impl_(std::make_unique<Impl>(queue, config)) {}
DeviceBroadPhase::~DeviceBroadPhase() = default;
DeviceBroadPhase::DeviceBroadPhase(DeviceBroadPhase&&) noexcept = default;
DeviceBroadPhase& DeviceBroadPhase::operator=(DeviceBroadPhase&&) noexcept = default;

DeviceBroadPhase::Result DeviceBroadPhase::update(const Boxes& boxes) {
  impl_->core->begin(boxes);
  return impl_->core->finish();
}

void DeviceBroadPhase::begin(const Boxes& boxes) {
  impl_->core->begin(boxes);
}

DeviceBroadPhase::Result DeviceBroadPhase::finish() {
  return impl_->core->finish();
}

void DeviceBroadPhase::reserve(std::size_t boxes, std::size_t pairs, bool filters) {
  impl_->core->reserve(boxes, pairs, filters);
}

void DeviceBroadPhase::shrink() {
  impl_->core->shrink();
}

void DeviceBroadPhase::set_exclusions(std::span<const Pair> pairs) {
  impl_->core->set_exclusions(pairs);
}

void DeviceBroadPhase::enqueue(const Boxes& boxes, const ChangeBuffers& changes) {
  impl_->core->enqueue(boxes, changes);
}

DeviceBroadPhase::PairBuffer DeviceBroadPhase::pairs() {
  return impl_->core->pairs();
}

const Device& DeviceBroadPhase::device() const noexcept {
  return impl_->core->context().device();
}

MemoryUse DeviceBroadPhase::memory() const noexcept {
  return impl_->core->memory();
}

std::span<const Stage> DeviceBroadPhase::profile() const noexcept {
  return impl_->core->profile();
}

}  // namespace broadcl
