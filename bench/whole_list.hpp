#pragma once

namespace broadcl {

/// Benchmarks of finding all pairs at once, as for a new scene, in sets of real boxes:
///
///   whole-list/SET
///
/// From boxes on the device to the list of all pairs there, in no order, by `tiles`: sorting, building and
/// searching, until the queue has finished. SET is a file of the folder that BROADCL_TEST_DATA names, without
/// ".npy"; where that is not set there are no such benchmarks.
void register_whole_list();

}  // namespace broadcl
