#pragma once

namespace broadcl {

/// Benchmarks of boxes that are already on the device, all of which move in every frame:
///
///   update-device/ALGORITHM/SCENE/N   DeviceBroadPhase::update(), until its queue has finished
///   update-enqueue/ALGORITHM/SCENE/N  DeviceBroadPhase::enqueue(), eight frames at a time, until the queue
///                                     has finished; the time of one frame
///
/// The changes stay on the device, in canonical order. Writing the boxes of the next frames is not timed.
void register_device_frames();

}  // namespace broadcl
