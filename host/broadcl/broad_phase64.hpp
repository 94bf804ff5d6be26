#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/broad_phase.hpp>

namespace broadcl {

/// A broad phase whose boxes are in double precision: each update() reports exactly which pairs began and
/// which ceased to overlap or touch as float64, however near or far their bounds, at any distance from 0, on
/// every device and on the host. A box that moves by less than float32 can tell moves.
///
/// Boxes are searched as float32, by a map of each axis that keeps their order and leaves out the empty space
/// between places where boxes are. Pairs that touch there are compared in float64, on the host: few, unless
/// many boxes lie side by side. The cost of an update depends on how much moved, as in a BroadPhase. When
/// boxes have gone elsewhere, the map is made anew, and that update searches all boxes. Each box takes 48
/// bytes of the host's memory in addition, 96 with update(boxes), and 48 more while a map is made.
///
/// Results do not depend on the rounding mode of the calling thread, nor on whether its processor treats
/// denormal numbers as 0.
using BroadPhase64 = BasicBroadPhase<Aabb64>;
/// Boxes in memory of a BroadPhase64, for the caller to write.
using MappedBoxes64 = BasicMappedBoxes<Aabb64>;

extern template class BROADCL_API BasicBroadPhase<Aabb64>;

}  // namespace broadcl

#endif
