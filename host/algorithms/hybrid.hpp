#pragma once

#include <functional>
#include <memory>

#include "algorithms/algorithm.hpp"

namespace broadcl {

/// Makes an algorithm that works on a device, or none if there is no device that would be faster than the
/// host. Called on another thread, at most once.
using OpenDevice = std::function<std::unique_ptr<Algorithm>()>;

/// An algorithm that works on the host or on the device, whichever is expected to be faster, and changes over
/// between updates. It begins on the host, unless there are too many objects for that at once.
[[nodiscard]] std::unique_ptr<Algorithm> make_hybrid(std::unique_ptr<Algorithm> host,
                                                     std::unique_ptr<Algorithm> device);

/// The same, but the device is opened, on a thread of its own, once updates on the host take long. If that
/// fails, all updates are done on the host. The destructor waits for the thread.
[[nodiscard]] std::unique_ptr<Algorithm> make_hybrid(std::unique_ptr<Algorithm> host, OpenDevice open);

}  // namespace broadcl
