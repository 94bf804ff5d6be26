#pragma once

#include <array>
#include <cstddef>

#include "algorithms/algorithm.hpp"
#include "opencl/context.hpp"

namespace broadcl {

/// What an update with a finder costs, in seconds.
struct CostModel {
  double frame = 0;  ///< Per frame, whatever there is to do.
  double slot = 0;   ///< Per slot.
  double work = 0;   ///< Per unit of PairFinder::expected_work().

  [[nodiscard]] double seconds(std::size_t slots, double units) const noexcept {
    return frame + slot * static_cast<double>(slots) + work * units;
  }
};

/// The models of two finders on a device. They are measured, which takes some milliseconds, when a device is
/// first used with this version of the kernels, and stored on disk.
/// @throws cl::Error, Error
[[nodiscard]] std::array<CostModel, 2> calibrate(const opencl::Context& context,
                                                 const std::array<MakePairFinder, 2>& finders);

}  // namespace broadcl
