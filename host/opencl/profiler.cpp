#include "opencl/profiler.hpp"

#include <algorithm>
#include <limits>

namespace broadcl::opencl {
namespace {

double seconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

Profiler::Scope::Scope(Profiler& profiler, std::string_view name)
    : profiler_(profiler), stage_(profiler.stages_.size()), start_(std::chrono::steady_clock::now()) {
  profiler_.stages_.push_back({.name = name,
                               .host_start = seconds(start_ - profiler_.begin_),
                               .host_seconds = 0,
                               .device_start = 0,
                               .device_seconds = 0});
  profiler_.events_.emplace_back();
}

Profiler::Scope::~Scope() {
  profiler_.stages_[stage_].host_seconds = seconds(std::chrono::steady_clock::now() - start_);
}

cl::Event* Profiler::Scope::event() noexcept {
  return profiler_.device_times_ ? &profiler_.events_[stage_] : nullptr;
}

void Profiler::begin() {
  stages_.clear();
  events_.clear();
  begin_ = std::chrono::steady_clock::now();
}

void Profiler::resolve() {
  const auto start_of = [](const cl::Event& event) {
    return event.getProfilingInfo<CL_PROFILING_COMMAND_START>();
  };
  cl_ulong first = std::numeric_limits<cl_ulong>::max();
  for (const cl::Event& event : events_) {
    if (event() != nullptr) first = std::min(first, start_of(event));
  }
  for (std::size_t k = 0; k < stages_.size(); ++k) {
    if (events_[k]() == nullptr) continue;
    const cl_ulong start = start_of(events_[k]);
    const auto end = events_[k].getProfilingInfo<CL_PROFILING_COMMAND_END>();
    stages_[k].device_start = static_cast<double>(start - first) * 1e-9;
    stages_[k].device_seconds = static_cast<double>(end - start) * 1e-9;
  }
}

}  // namespace broadcl::opencl
