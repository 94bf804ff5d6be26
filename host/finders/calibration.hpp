#pragma once

#include <array>
#include <cstddef>

#include "engines/algorithm.hpp"
#include "opencl/context.hpp"

namespace broadcl {

/// What an update with a finder costs, in seconds.
struct CostModel {
  double frame = 0;  ///< Per frame, regardless of the work.
  double slot = 0;   ///< Per slot.
  /// Per unit of PairFinder::expected_work(), if some slots changed and if all did.
  std::array<double, 2> work{};

  [[nodiscard]] double seconds(std::size_t slots, bool all, double units) const noexcept {
    return frame + slot * static_cast<double>(slots) + work.at(all ? 1 : 0) * units;
  }
};

/// The models of two finders on a device. They are measured when a device is first used with this version of
/// the kernels, which takes some tens of milliseconds, and then stored on disk.
/// @throws cl::Error, Error
[[nodiscard]] std::array<CostModel, 2> calibrate(const opencl::Context& context,
                                                 const std::array<MakePairFinder, 2>& finders);

/// Stores the models that calibrate() returns from now on.
void store_models(const opencl::Context& context, const std::array<CostModel, 2>& models);

}  // namespace broadcl
