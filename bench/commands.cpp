#include "benchmarks.hpp"

#include <cstddef>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "frame_times.hpp"
#include "opencl/context.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t items = 4096;
constexpr std::size_t group = 128;
constexpr std::size_t most_buffers = 14;
constexpr int iterations = 256;

cl::Kernel build(const opencl::Context& context, const std::string& source) {
  const cl::Program program(context.context(), source);
  program.build();
  return {program, "run"};
}

void enqueue(const opencl::Context& context, const cl::Kernel& kernel) {
  context.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(items), cl::NDRange(group));
}

/// The time that the host takes to enqueue a kernel that does nothing.
void time_enqueueing(benchmark::State& state, std::size_t buffers) {
  const opencl::Context context(select_device(), false);
  std::string source = "kernel void run(global uint* b0";
  for (std::size_t k = 1; k < buffers; ++k) source.append(", global uint* b").append(std::to_string(k));
  cl::Kernel kernel = build(context, source.append(") {}"));
  std::vector<cl::Buffer> arguments;
  for (std::size_t k = 0; k < buffers; ++k) {
    arguments.push_back(context.buffer(items));
    kernel.setArg(static_cast<cl_uint>(k), arguments.back());
  }
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    context.queue().finish();
    frames.time([&] {
      enqueue(context, kernel);
      return std::size_t{0};
    });
  }
  context.queue().finish();
  frames.report();
}

/// The time from enqueueing a kernel that takes a while to its end, or to that of a read that follows it.
void time_waiting(benchmark::State& state, cl_uint steps, bool reads) {
  const opencl::Context context(select_device(), false);
  cl::Kernel kernel = build(context,
                            "kernel void run(global uint* x, const uint steps) {"
                            "  uint y = x[1];"
                            "  for (uint k = 0; k < steps; ++k) y = y * 1664525U + 1013904223U + (y >> 7);"
                            "  if (get_global_id(0) == 0 || y == 7U) x[0] = y;"
                            "}");
  const cl::Buffer buffer = context.buffer(items);
  opencl::set_arguments(kernel, 0, buffer, steps);
  std::vector<std::byte> result(items);
  FrameTimes frames(state);
  for ([[maybe_unused]] auto _ : state) {
    context.queue().finish();
    frames.time([&] {
      enqueue(context, kernel);
      if (reads) {
        cl::Event read;
        context.queue().enqueueReadBuffer(buffer, CL_FALSE, 0, result.size(), result.data(), nullptr, &read);
        context.queue().flush();
        read.wait();
      } else {
        context.queue().finish();
      }
      return std::size_t{0};
    });
  }
  frames.report();
}

}  // namespace

void register_commands() {
  for (const std::size_t buffers : {std::size_t{1}, most_buffers / 2, most_buffers}) {
    benchmark::RegisterBenchmark(("commands/enqueue/" + std::to_string(buffers)).c_str(), time_enqueueing,
                                 buffers)
        ->UseManualTime()
        ->Iterations(iterations)
        ->Unit(benchmark::kMicrosecond);
  }
  for (const bool reads : {false, true}) {
    for (cl_uint steps = 0; steps <= 4000; steps += 500) {
      const std::string name = reads ? "commands/read/" : "commands/finish/";
      benchmark::RegisterBenchmark((name + std::to_string(steps)).c_str(), time_waiting, steps, reads)
          ->UseManualTime()
          ->Iterations(iterations)
          ->Unit(benchmark::kMicrosecond);
    }
  }
}

}  // namespace broadcl
