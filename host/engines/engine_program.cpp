#include "engines/engine_program.hpp"

#include <string>

namespace broadcl {
namespace {

constexpr EngineLaunch engine_on_gpus{.group = 256, .keep_chunk = 4};
constexpr EngineLaunch engine_on_cpus{.group = 1, .keep_chunk = 256};

}  // namespace

const EngineLaunch& engine_launch(const opencl::Context& context) noexcept {
  return context.tuning() == opencl::Tuning::cpu ? engine_on_cpus : engine_on_gpus;
}

cl::Program engine_program(const opencl::Context& context) {
  const EngineLaunch& launch = engine_launch(context);
  return context.program("engine.cl", "-DGROUP=" + std::to_string(launch.group) +
                                          " -DCHUNK=" + std::to_string(launch.keep_chunk));
}

}  // namespace broadcl
