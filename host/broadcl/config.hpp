#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace broadcl {

/// How an object of this library works: which device and which algorithm it uses, and what it measures. A
/// plain value, which is read once, when the object is made.
struct Config {
  /// A selector as select_device() takes it; not used by an algorithm of the host.
  std::string device{};

  /// The name of a row of algorithms(). The default chooses among the algorithms of the device.
  std::string algorithm = "auto";

  /// Threads that an algorithm of the host may use, the caller's included; 0 for as many as there are
  /// processors.
  std::size_t threads = 0;

  /// Measure stages on the device too: see Stage. Costs a few microseconds per update.
  bool profile = false;
};

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< As Config::algorithm takes it.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for an algorithm of the host, which needs no OpenCL.
};

/// The table of algorithms, which is the only list of them. The rows are constant and always valid; any
/// number of threads may read them.
[[nodiscard]] std::span<const AlgorithmInfo> algorithms() noexcept;

}  // namespace broadcl
