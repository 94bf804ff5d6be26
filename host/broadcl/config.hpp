#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

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

  /// The name of a row of algorithms(). The default uses the device that is named, here or by BROADCL_DEVICE.
  /// If none is, it uses a GPU, and works on the host if there is none: a device that is a CPU has no more to
  /// offer than that.
  std::string algorithm = "auto";

  /// Threads that an algorithm of the host may use, the caller's included; 0 for as many as there are
  /// processors.
  std::size_t threads = 0;

  /// Measure stages on the device too: see Stage. Costs a few microseconds per update.
  bool profile = false;

  /// What it throws passes through the call that compiles.
  CompileHandler on_compile{};
};

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< As Config::algorithm takes it.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for an algorithm of the host; `auto` may use either.
};

/// The device that an object with this Config uses, or none if it works on the host. Any number of threads
/// may call it at once.
/// @throws Error for an unknown algorithm or device, and if OpenCL fails. (The default then works on the
/// host; devices() tells what failed.)
[[nodiscard]] std::optional<Device> device_for(const Config& config);

/// The table of algorithms, which is the only list of them. The rows are constant and always valid; any
/// number of threads may read them.
[[nodiscard]] std::span<const AlgorithmInfo> algorithms() noexcept;

}  // namespace broadcl
