#pragma once

namespace broadcl {

/// Benchmarks of boxes that are already on the device, all of which move in every frame:
///
///   update-device/ALGORITHM/SCENE/N   DeviceBroadPhase::update(), until its queue has finished
///
/// The changes stay on the device, in canonical order. Writing the boxes of the next frame is not timed.
void register_device_frames();

}  // namespace broadcl
