#pragma once

#include <functional>
#include <memory>

#include "algorithms/algorithm.hpp"

namespace broadcl {

/// Makes an algorithm that works on a device; null if no device would be faster than the host. Called in
/// another thread, at most once.
using OpenDevice = std::function<std::unique_ptr<Algorithm>()>;

/// An algorithm that works on the host or on the device, whichever is expected to be faster, and may switch
/// between updates. It starts on the host, unless so many objects are reserved before the first update that
/// the device is expected to be faster. If the device fails, that is an error, and all further updates are
/// done on the host, unless the pairs can no longer be read from the device.
[[nodiscard]] std::unique_ptr<Algorithm> make_hybrid(std::unique_ptr<Algorithm> host,
                                                     std::unique_ptr<Algorithm> device);

/// The same, but the device is opened, in a background thread, once updates on the host take long. If that
/// fails, all updates are done on the host. The destructor waits for the thread.
[[nodiscard]] std::unique_ptr<Algorithm> make_hybrid(std::unique_ptr<Algorithm> host, OpenDevice open);

}  // namespace broadcl
