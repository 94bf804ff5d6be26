#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include <broadcl/config.hpp>
#include <broadcl/device.hpp>

#include "opencl/api.hpp"
#include "opencl/disk_cache.hpp"

namespace broadcl::opencl {

/// The programs of a context, each of which is built once, or loaded from disk. Several threads may use them.
class Programs {
 public:
  /// @param disk_cache Of the device; must outlive the programs.
  Programs(Device device, cl::Device cl_device, cl::Context context, const DiskCache& disk_cache);

  /// @param file Name of a file of kernels/.
  /// @param options For the compiler.
  /// @param on_compile Called and emptied before the program is built from its source, unless it is empty.
  /// @throws cl::Error; Error with the compiler's log, which names file and line, if it does not compile.
  [[nodiscard]] cl::Program get(std::string_view file, const std::string& options,
                                CompileHandler& on_compile);

 private:
  [[nodiscard]] cl::Program build(std::string_view file, const std::string& source,
                                  const std::string& options, CompileHandler& on_compile) const;
  [[nodiscard]] std::optional<cl::Program> from_binary(const DiskCache::Bytes& binary,
                                                       const std::string& options) const;

  Device device_;
  cl::Device cl_device_;
  cl::Context context_;
  const DiskCache& disk_cache_;
  std::mutex mutex_;
  std::map<std::string, cl::Program> built_;  // by options and source
};

}  // namespace broadcl::opencl
