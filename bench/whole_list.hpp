#pragma once

namespace broadcl {

/// Benchmarks of finding all pairs at once, as for a new scene, in sets of real-world boxes:
///
///   whole-list/SET
///
/// From boxes on the device to the unordered list of all pairs there, with `tiles`: sorting, building the
/// tree and searching, until the queue has finished. SET is the name, without ".npy", of a file in the folder
/// that BROADCL_TEST_DATA names; if the variable is not set, these benchmarks do not exist.
void register_whole_list();

}  // namespace broadcl
