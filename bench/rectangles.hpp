#pragma once

namespace broadcl {

/// Benchmarks of an update of all boxes in two dimensions, from memory of the caller:
///
///   rectangles/ALGORITHM/N             given as rectangles
///   rectangles/ALGORITHM/N/as-boxes    given as boxes with z = 0
void register_rectangles();

}  // namespace broadcl
