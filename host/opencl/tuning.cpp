#include "opencl/tuning.hpp"

#include <broadcl/error.hpp>

#include "base/system.hpp"

namespace broadcl::opencl {

std::string_view to_string(Tuning tuning) noexcept {
  switch (tuning) {
    case Tuning::gpu:
      return "gpu";
    case Tuning::gpu64:
      return "gpu64";
    case Tuning::cpu:
      break;
  }
  return "cpu";
}

std::optional<Tuning> named_tuning() {
  const auto name = environment("BROADCL_TUNING");
  if (!name) return std::nullopt;
  for (const Tuning tuning : {Tuning::gpu, Tuning::gpu64, Tuning::cpu}) {
    if (*name == to_string(tuning)) return tuning;
  }
  throw Error("BROADCL_TUNING is '" + *name + "'; set it to gpu, gpu64 or cpu");
}

}  // namespace broadcl::opencl
