#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "base/threads.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Makes an algorithm that works on a device; null if no device would be faster than the host. Called in
/// another thread, at most once. Empty if there is no device.
using OpenDevice = std::function<AlgorithmPointer()>;

/// Returns the present time.
using Now = std::function<std::chrono::steady_clock::time_point()>;

/// An algorithm that starts on the host, opens a device once updates take long, and then uses the one that is
/// expected to be faster; it may switch between updates. The device is opened in a background thread, and the
/// destructor waits for that. If opening fails with an Error, the next update throws it; if the device fails
/// later, that is an error, too. All further updates are then done on the host, unless the pairs can no
/// longer be read from the device.
/// @param slow_update Updates that take more seconds are slow. The device is opened once slow updates in a
/// row have taken 100 times as long.
/// @param threads For its own work on the host, at most; 0 for one per processor.
/// @param now Measures updates.
[[nodiscard]] AlgorithmPointer make_hybrid(AlgorithmPointer host, OpenDevice open, double slow_update,
                                           const Threads& threads = 1,
                                           Now now = std::chrono::steady_clock::now);

}  // namespace broadcl
