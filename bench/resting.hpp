#pragma once

namespace broadcl {

/// Benchmarks of a Bullet world in which some objects move and the others sleep: updateAabbs() and
/// computeOverlappingPairs().
///
///   resting/NAME/MOVING/N        MOVING of N objects move by a tenth of their edge
///   resting/NAME/MOVING/N/skip   the same after setForceUpdateAllAabbs(false)
///
/// NAME is one of scenes::broadphases().
void register_resting();

}  // namespace broadcl
