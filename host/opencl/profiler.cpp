#include "opencl/profiler.hpp"

#include <algorithm>
#include <limits>
#include <vector>

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
}

Profiler::Scope::~Scope() {
  profiler_.stages_[stage_].host_seconds = seconds(std::chrono::steady_clock::now() - start_);
}

cl::Event* Profiler::Scope::event() {
  if (!profiler_.device_times_) return nullptr;
  return &profiler_.commands_.emplace_back(Command{.stage = stage_, .event = {}}).event;
}

void Profiler::begin() {
  stages_.clear();
  commands_.clear();
  begin_ = std::chrono::steady_clock::now();
}

void Profiler::resolve() {
  const auto start_of = [](const cl::Event& event) {
    return event.getProfilingInfo<CL_PROFILING_COMMAND_START>();
  };
  const auto end_of = [](const cl::Event& event) {
    return event.getProfilingInfo<CL_PROFILING_COMMAND_END>();
  };
  std::erase_if(commands_, [](const Command& command) { return command.event() == nullptr; });
  constexpr cl_ulong never = std::numeric_limits<cl_ulong>::max();
  cl_ulong first = never;
  std::vector<cl_ulong> starts(stages_.size(), never);
  for (const auto& [stage, event] : commands_) {
    event.wait();
    const cl_ulong start = start_of(event);
    first = std::min(first, start);
    starts[stage] = std::min(starts[stage], start);
    stages_[stage].device_seconds += static_cast<double>(end_of(event) - start) * 1e-9;
  }
  for (std::size_t k = 0; k < stages_.size(); ++k) {
    if (starts[k] != never) stages_[k].device_start = static_cast<double>(starts[k] - first) * 1e-9;
  }
}

}  // namespace broadcl::opencl
