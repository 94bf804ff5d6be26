#pragma once

#include <optional>
#include <string_view>

namespace broadcl::opencl {

/// The tuning of kernels: many small work-items that share local memory (gpu), the same on a GPU that
/// runs 64 of them in lockstep (gpu64), or few work-items that each do a lot of work (cpu).
enum class Tuning { gpu, gpu64, cpu };

/// "gpu", "gpu64" or "cpu".
[[nodiscard]] std::string_view to_string(Tuning tuning) noexcept;

/// The tuning that the environment variable BROADCL_TUNING names, if any.
/// @throws Error if it names none.
[[nodiscard]] std::optional<Tuning> named_tuning();

}  // namespace broadcl::opencl
