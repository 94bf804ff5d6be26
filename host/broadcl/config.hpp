#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <broadcl/export.h>
#include <broadcl/device.hpp>

namespace broadcl {

/// Called once by an object that has to compile kernels, before it does so, because that may take many
/// seconds; a second time if the device turns out to need other kernels, for smaller work-groups. Kernels are
/// compiled once for each device and driver or, without a cache, at every start.
/// @param cache_folder Where they are stored for the next start; empty if they cannot be stored.
using CompileHandler = std::function<void(const Device& device, const std::string& cache_folder)>;

/// How an object of this library works: which device and which algorithm it uses, and what it measures. A
/// plain value, read once when the object is made.
struct Config {
  /// A selector as for select_device(); not used by an algorithm of the host.
  std::string device{};

  /// The name of a row of algorithms().
  ///
  /// The default works on the host or on a GPU, whichever is expected to be faster. It starts on the host.
  /// Once updates take more than 0.1 ms each, 10 ms in all, it opens the best GPU, if there is any, in a
  /// background thread; a GPU that is named, here or by BROADCL_DEVICE, from 0.03 and 3 ms on. Updates
  /// continue on the host until its kernels are built. The destructor waits for that thread. If a GPU that is
  /// named cannot be opened, the next update throws that error; if a GPU fails later, that is an error, too.
  /// All further updates are then done on the host, unless the pairs can no longer be read from the GPU. The
  /// thread reads environment variables: set none while an object works that may open a GPU.
  ///
  /// If a CPU is named, it is opened when the object is made, and does all updates, although the host would
  /// be faster.
  std::string algorithm = "auto";

  /// Number of threads that an algorithm of the host may use, including the caller's; 0 for one per
  /// processor. (Hundreds of thousands of boxes are copied by as many threads as there are processors.)
  std::size_t threads = 0;

  /// Whether to measure stages on the device, too: see Stage. Costs a few microseconds per update.
  bool profile = false;

  /// Exceptions that it throws pass through the call that compiles. `auto` may call it in another thread; if
  /// it throws there, the device is not used.
  CompileHandler on_compile{};
};

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< The value for Config::algorithm.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for an algorithm of the host; `auto` may use either.
};

/// The device that an object with this Config opens when it is made; none if it works on the host, always or
/// at first, as `auto` does unless a CPU is named. Any number of threads may call this at the same time.
/// @throws Error for an unknown algorithm or device, and if OpenCL fails.
[[nodiscard]] BROADCL_API std::optional<Device> device_for(const Config& config);

/// The table of all algorithms. The rows are constant and always valid; any number of threads may read them.
[[nodiscard]] BROADCL_API std::span<const AlgorithmInfo> algorithms() noexcept;

}  // namespace broadcl
