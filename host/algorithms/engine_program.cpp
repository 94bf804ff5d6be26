#include "algorithms/engine_program.hpp"

#include <string>

namespace broadcl {
namespace {

constexpr EngineLaunch engine_on_gpus{.keep_group = 256, .keep_chunk = 4, .parts = 128, .teams = 2};
constexpr EngineLaunch engine_on_cpus{.keep_group = 1, .keep_chunk = 256, .parts = 1, .teams = 1};

}  // namespace

const EngineLaunch& engine_launch(const opencl::Context& context) noexcept {
  return context.tuning() == opencl::Tuning::cpu ? engine_on_cpus : engine_on_gpus;
}

cl::Program engine_program(const opencl::Context& context) {
  const EngineLaunch& launch = engine_launch(context);
  return context.program("engine.cl", "-DGROUP=" + std::to_string(launch.keep_group) +
                                          " -DCHUNK=" + std::to_string(launch.keep_chunk) +
                                          " -DPARTS=" + std::to_string(launch.parts) +
                                          " -DTEAMS=" + std::to_string(launch.teams));
}

}  // namespace broadcl
