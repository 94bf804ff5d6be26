#pragma once

#include <memory>

#include "algorithms/algorithm.hpp"
#include "algorithms/pair_finder.hpp"

namespace broadcl {

/// An algorithm that finds pairs, and what changed of them, on the device. It brings to it what changed of
/// the objects, and back what changed of the pairs.
[[nodiscard]] std::unique_ptr<Algorithm> make_delta_engine(const BroadPhase::Config& config,
                                                           MakePairFinder make_finder);

}  // namespace broadcl
