#pragma once

namespace broadcl {

/// Benchmarks of finding all pairs at once, as for a new scene, in sets of real-world boxes:
///
///   whole-list/SET
///   whole-call/ALGORITHM/SET
///
/// `whole-list` is the time from boxes on the device to the unordered list of all pairs there, with `tiles`:
/// sorting, building the tree and searching, until the queue has finished. `whole-call` is that of
/// overlapping_pairs() without opening the device: from boxes on the host to the sorted list there. SET is
/// the name, without ".npy", of a file in the folder that BROADCL_TEST_DATA names; if the variable is not
/// set, these benchmarks do not exist.
void register_whole_list();

}  // namespace broadcl
