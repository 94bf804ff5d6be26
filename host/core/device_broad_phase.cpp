#include "core/device_core.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/opencl.hpp>

#include <utility>

#include "opencl/process.hpp"

namespace broadcl {

class DeviceBroadPhase::Impl : public DeviceCore {
 public:
  using DeviceCore::DeviceCore;
};

DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue) : DeviceBroadPhase(queue, Config()) {}
DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue, const Config& config)
    : impl_(opencl::make_tuned([&](std::optional<opencl::Tuning> tuning) {
        return std::make_unique<Impl>(queue, config, tuning);
      })) {}
DeviceBroadPhase::~DeviceBroadPhase() {
  opencl::DeleteUnlessForked()(impl_.release());
}
DeviceBroadPhase::DeviceBroadPhase(DeviceBroadPhase&&) noexcept = default;
DeviceBroadPhase& DeviceBroadPhase::operator=(DeviceBroadPhase&& other) noexcept {
  DeviceBroadPhase taken(std::move(other));
  impl_.swap(taken.impl_);
  return *this;
}

DeviceBroadPhase::Result DeviceBroadPhase::update(const Boxes& boxes) {
  impl_->begin(boxes);
  return impl_->finish();
}

void DeviceBroadPhase::begin(const Boxes& boxes) {
  impl_->begin(boxes);
}

DeviceBroadPhase::Result DeviceBroadPhase::finish() {
  return impl_->finish();
}

void DeviceBroadPhase::reserve(std::size_t boxes, std::size_t pairs, bool filters) {
  impl_->reserve(boxes, pairs, filters);
}

void DeviceBroadPhase::shrink() {
  impl_->shrink();
}

void DeviceBroadPhase::set_exclusions(std::span<const Pair> pairs) {
  impl_->set_exclusions(pairs);
}

void DeviceBroadPhase::enqueue(const Boxes& boxes, const ChangeBuffers& changes) {
  impl_->enqueue(boxes, changes);
}

DeviceBroadPhase::PairBuffer DeviceBroadPhase::pairs() {
  return impl_->pairs();
}

const Device& DeviceBroadPhase::device() const noexcept {
  return impl_->context().device();
}

MemoryUse DeviceBroadPhase::memory() const noexcept {
  return impl_->context().memory();
}

std::span<const Stage> DeviceBroadPhase::profile() const noexcept {
  return impl_->profile();
}

}  // namespace broadcl
