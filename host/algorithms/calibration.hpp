#pragma once

#include <array>

#include "algorithms/algorithm.hpp"
#include "algorithms/chooser.hpp"
#include "opencl/context.hpp"

namespace broadcl {

/// What makes a finder of pairs, and what its searches are thought to cost.
struct Contestant {
  MakePairFinder make = nullptr;
  CostModel model;
};

/// What was measured of a contestant.
struct Calibration {
  CostModel model;
  double grain = 1;  ///< That suits the device: one of PairFinder::grains, or what the environment asks for.
};

/// Brings models to what searches really cost on a device: a frame, a slot, and what else the model has in
/// its proportion; and chooses the grain, but for one that the environment asks for. That is measured in some
/// milliseconds, the first time that a device is met by this version of the kernels, and kept on disk from
/// then on.
/// @throws cl::Error, Error
[[nodiscard]] std::array<Calibration, 2> calibrate(const opencl::Context& context,
                                                   const std::array<Contestant, 2>& contestants);

}  // namespace broadcl
