#include "opencl/programs.hpp"

#include <utility>

#include <broadcl/error.hpp>

#include "opencl/kernel_source.hpp"
#include "opencl/quirks.hpp"

namespace broadcl::opencl {
namespace {

/// To be held while a program is built.
std::unique_lock<std::mutex> lock_for_building(const Quirks& quirks) {
  static std::mutex one_at_a_time;
  return quirks.builds_one_at_a_time ? std::unique_lock(one_at_a_time) : std::unique_lock<std::mutex>();
}

}  // namespace

Programs::Programs(Device device, cl::Device cl_device, cl::Context context, const DiskCache& disk_cache)
    : device_(std::move(device)),
      cl_device_(std::move(cl_device)),
      context_(std::move(context)),
      disk_cache_(disk_cache) {}

cl::Program Programs::get(std::string_view file, const std::string& options, CompileHandler& on_compile) {
  const std::string source = kernel_source(file);
  const std::string key = options + '\0' + source;
  {
    const std::scoped_lock lock(mutex_);
    if (const auto known = built_.find(key); known != built_.end()) return known->second;
  }
  // Without the lock: the handler may use the library. If several threads get here, the first one counts.
  const cl::Program program = build(file, source, options, on_compile);
  const std::scoped_lock lock(mutex_);
  return built_.emplace(key, program).first->second;
}

/// A program from a cached binary; none if the driver rejects it.
std::optional<cl::Program> Programs::from_binary(const DiskCache::Bytes& binary,
                                                 const std::string& options) const {
  try {
    cl::Program program(context_, {cl_device_}, {binary});
    program.build(cl_device_, options.c_str());
    return program;
  } catch (const cl::Error&) {
    return std::nullopt;
  }
}

cl::Program Programs::build(std::string_view file, const std::string& source, const std::string& options,
                            CompileHandler& on_compile) const {
  const std::string key = options + '\0' + source;
  const DiskCache::Bytes binary = disk_cache_.load(key);
  // If the driver keeps programs, only a marker is stored, so that on_compile is not called again.
  const Quirks quirks = quirks_of(device_);
  if (!binary.empty() && !quirks.keeps_programs) {
    if (auto program = from_binary(binary, options)) return *program;
  }
  if (binary.empty() || !quirks.keeps_programs) {
    if (const CompileHandler handler = std::exchange(on_compile, {})) {
      // Whether the binary can be stored there shows by storing an empty one.
      const bool is_stored = disk_cache_.store(key, {});
      handler(device_, is_stored ? disk_cache_.folder().string() : "");
    }
  }
  cl::Program program(context_, source);
  try {
    const auto lock = lock_for_building(quirks);
    program.build(cl_device_, options.c_str());
  } catch (const cl::BuildError&) {
    throw Error(device_.label() + ": " + std::string(file) + " does not compile:\n" +
                with_file_names(program.getBuildInfo<CL_PROGRAM_BUILD_LOG>(cl_device_), source));
  }
  if (quirks.keeps_programs) {
    if (binary.empty()) (void)disk_cache_.store(key, {'1'});
    return program;
  }
  const auto binaries = program.getInfo<CL_PROGRAM_BINARIES>();
  if (binaries.size() == 1 && !binaries.front().empty()) (void)disk_cache_.store(key, binaries.front());
  return program;
}

}  // namespace broadcl::opencl
