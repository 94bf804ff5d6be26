#pragma once

namespace broadcl {

/// Benchmarks of finding all pairs of two sets at once, from boxes on the host to the list there, with a
/// device that is already open, and of one set of all these boxes:
///
///   two-sets/ALGORITHM/edges-faces, two-sets/ALGORITHM/edges-points
///   two-sets/ALGORITHM/edges-faces/as-one, two-sets/ALGORITHM/edges-points/as-one
///
/// `s/pair` is the time per pair found. Edges and faces are those of cloth-ball in the folder that
/// BROADCL_TEST_DATA names; points are boxes a tenth as large at the centres of the faces' boxes. If the
/// variable is not set, these benchmarks do not exist.
void register_two_sets();

}  // namespace broadcl
