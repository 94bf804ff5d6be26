#pragma once

namespace broadcl {

/// Benchmarks of many worlds at one place, in each of which cubes of one size move:
///
///   worlds/ALGORITHM/host/COUNTxN     BroadPhase::update(), as in update/
///   worlds/ALGORITHM/device/COUNTxN   DeviceBroadPhase::update(), as in update-device/
///   worlds/ALGORITHM/apart/COUNTxN    as host, but all in one world, in which they are moved apart
///
/// COUNT worlds of N boxes each. The last tells what it costs that the worlds are at one place.
void register_worlds();

}  // namespace broadcl
