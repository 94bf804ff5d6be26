#pragma once

namespace broadcl {

/// Benchmarks of many worlds in the same space, in each of which cubes of one size move:
///
///   worlds/ALGORITHM/host/COUNTxN     BroadPhase::update(), as in update/
///   worlds/ALGORITHM/device/COUNTxN   DeviceBroadPhase::update(), as in update-device/
///   worlds/ALGORITHM/apart/COUNTxN    as host, but all in one world, in which they are moved apart
///
/// COUNT worlds of N boxes each. The last one shows the cost of having the worlds in the same space.
void register_worlds();

}  // namespace broadcl
