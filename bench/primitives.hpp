#pragma once

namespace broadcl {

/// Benchmarks of the primitives, each next to a host thread that does the same:
///
///   centroids/NAME/N    bounds of the centroids of N boxes
///   scan/NAME/N         exclusive prefix sum of N uints
///   radix-sort/NAME/N   N random pairs {value, key} of uints, sorted by key
///
/// NAME is `device`, timed from the call until the queue has finished, or `host`.
void register_primitives();

}  // namespace broadcl
