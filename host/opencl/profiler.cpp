#include "opencl/profiler.hpp"

namespace broadcl::opencl {

Profiler::Scope::Scope(Profiler& profiler, std::string_view name)
    : profiler_(profiler), start_(std::chrono::steady_clock::now()) {
  profiler_.stages_.push_back({.name = name, .host_seconds = 0, .device_seconds = 0});
  profiler_.events_.emplace_back();
}

Profiler::Scope::~Scope() {
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  profiler_.stages_.back().host_seconds = elapsed.count();
}

cl::Event* Profiler::Scope::event() noexcept {
  return profiler_.device_times_ ? &profiler_.events_.back() : nullptr;
}

void Profiler::begin() {
  stages_.clear();
  events_.clear();
}

void Profiler::resolve() {
  for (std::size_t k = 0; k < stages_.size(); ++k) {
    if (events_[k]() == nullptr) continue;
    const auto start = events_[k].getProfilingInfo<CL_PROFILING_COMMAND_START>();
    const auto end = events_[k].getProfilingInfo<CL_PROFILING_COMMAND_END>();
    stages_[k].device_seconds = static_cast<double>(end - start) * 1e-9;
  }
}

}  // namespace broadcl::opencl
