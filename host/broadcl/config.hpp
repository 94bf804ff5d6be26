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

/// Called once by an object that has to compile kernels, before it does so, which may take many seconds. Each
/// device and driver needs that once; without a cache, every start does.
/// @param kept_in The folder of that cache, empty if there is none.
using CompileHandler = std::function<void(const Device& device, const std::string& kept_in)>;

/// How an object of this library works: which device and which algorithm it uses, and what it measures. A
/// plain value, which is read once, when the object is made.
struct Config {
  /// A selector as select_device() takes it; not used by an algorithm of the host.
  std::string device{};

  /// The name of a row of algorithms().
  ///
  /// The default works on the host or on a device, whichever is expected to be faster. If a device is named,
  /// here or by BROADCL_DEVICE, it is opened when the object is made. (One that is a CPU does all updates
  /// then, although the host would be faster.) Otherwise no device is opened before updates on the host take
  /// more than 0.1 ms each; then the best GPU is, if there is one, on a thread of its own, and updates go on
  /// on the host until its kernels are built. The destructor waits for that thread.
  std::string algorithm = "auto";

  /// Threads that an algorithm of the host may use, the caller's included; 0 for as many as there are
  /// processors.
  std::size_t threads = 0;

  /// Measure stages on the device too: see Stage. Costs a few microseconds per update.
  bool profile = false;

  /// What it throws passes through the call that compiles. `auto` may call it on another thread, and does not
  /// use the device then if it throws.
  CompileHandler on_compile{};
};

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< As Config::algorithm takes it.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for an algorithm of the host; `auto` may use either.
};

/// The device that an object with this Config opens when it is made; none if it works on the host, always or
/// at first. Any number of threads may call it at once.
/// @throws Error for an unknown algorithm or device, and if OpenCL fails.
[[nodiscard]] BROADCL_API std::optional<Device> device_for(const Config& config);

/// The table of algorithms, which is the only list of them. The rows are constant and always valid; any
/// number of threads may read them.
[[nodiscard]] BROADCL_API std::span<const AlgorithmInfo> algorithms() noexcept;

}  // namespace broadcl
