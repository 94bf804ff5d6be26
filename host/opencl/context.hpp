#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/memory.hpp>

#include "base/non_copyable.hpp"
#include "opencl/api.hpp"
#include "opencl/disk_cache.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/opened_device.hpp"
#include "opencl/tuning.hpp"

namespace broadcl::opencl {

/// The device runs a kernel only in smaller work-groups, or has too little local memory for large ones, and
/// nobody named the tuning with such large ones: make_tuned() catches it.
class GroupTooLarge : public Error {
 public:
  using Error::Error;
};

/// What one object needs on a device that it shares with others: an in-order queue, the tuning of its
/// kernels, and a count of its memory.
class Context : NonCopyable {
 public:
  /// @param profile Whether the queue records device times.
  /// @param on_compile Called before the first program is built from its source.
  /// @param tuning In place of the tuning that suits the device.
  /// @throws Error naming the device.
  Context(const Device& device, bool profile, CompileHandler on_compile = {},
          std::optional<Tuning> tuning = std::nullopt);
  /// Works in the context of a queue of the caller, which is retained.
  /// @throws Error for a queue that is not in order.
  explicit Context(const cl::CommandQueue& queue, CompileHandler on_compile = {},
                   std::optional<Tuning> tuning = std::nullopt);
  /// Waits for the remaining commands in its own queue, for instance the release of mapped memory: Intel's
  /// runtime may crash if the process ends earlier.
  ~Context();

  [[nodiscard]] const Device& device() const noexcept { return opened_->device; }
  [[nodiscard]] const cl::Context& context() const noexcept { return opened_->context; }
  [[nodiscard]] const cl::CommandQueue& queue() const noexcept { return queue_; }
  /// Expires when the destructor begins.
  [[nodiscard]] std::weak_ptr<const void> life() const noexcept { return life_; }
  /// Another in-order queue with the same properties. Its owner has to wait for it: guard() does not.
  /// @throws cl::Error
  [[nodiscard]] cl::CommandQueue second_queue() const;
  /// The tuning. The environment variable BROADCL_TUNING overrides it, so that each tuning can be
  /// tested on any device.
  [[nodiscard]] Tuning tuning() const noexcept { return tuning_; }
  [[nodiscard]] const LaunchParameters& launch() const noexcept { return launch_parameters(tuning_); }

  /// Whether the 32 work-items of a work-group can vote with NVIDIA's instruction: kernels/vote.h. False if
  /// BROADCL_TUNING is set, so that kernels can be tested without the instruction.
  [[nodiscard]] bool has_nvidia_vote() const noexcept { return findings_.has_nvidia_vote; }

  /// Buffers larger than Device::max_allocation.
  struct LargeBuffers {
    std::string option;  ///< Compiler option for kernels that use them: makes addresses 64 bits wide.
    std::uint64_t most;  ///< Bytes per buffer.
  };
  /// On Intel's GPUs, buffers may be as large as the memory; other devices do not allow larger ones.
  [[nodiscard]] std::optional<LargeBuffers> large_buffers() const;

  /// A buffer on the device, not initialised.
  /// @param bytes At least 1. More than Device::max_allocation is for kernels that were built for
  /// large_buffers().
  /// @param flags In addition to CL_MEM_READ_WRITE.
  /// @throws cl::Error
  [[nodiscard]] cl::Buffer buffer(std::size_t bytes, cl_mem_flags flags = 0) const;
  /// The same in pinned memory of the host.
  [[nodiscard]] cl::Buffer pinned(std::size_t bytes) const;
  /// Whether there is direct memory: memory of the host that kernels access over the bus, also while it is
  /// mapped. False if host and device share memory anyway, and if BROADCL_TUNING is set, so that a device can
  /// be tested without.
  [[nodiscard]] bool has_direct_memory() const noexcept { return findings_.create_direct != nullptr; }
  /// A buffer in direct memory.
  [[nodiscard]] cl::Buffer direct(std::size_t bytes) const;
  /// The memory of the buffers that buffer(), pinned() and direct() made. A buffer counts until nothing
  /// refers to it, including commands and kernel arguments.
  [[nodiscard]] MemoryUse memory() const noexcept;

  [[nodiscard]] const DiskCache& disk_cache() const noexcept { return opened_->disk_cache; }

  /// Builds a kernel file, or loads its binary from the cache, if it has not done so before.
  /// @param file Name of a file of kernels/.
  /// @param options For the compiler, for instance "-DWIDTH=4".
  /// @throws Error with the compiler's log, which names file and line, if it does not compile.
  [[nodiscard]] cl::Program program(std::string_view file, const std::string& options = {}) const;

  /// A kernel of a program, for work-groups of one size.
  /// @param group Work-items per work-group.
  /// @throws cl::Error; GroupTooLarge; Error if the device cannot run it, or not as BROADCL_TUNING says.
  [[nodiscard]] cl::Kernel kernel(const cl::Program& program, const char* name, std::size_t group) const;

  /// A kernel of a program, for work-groups of any size: of the largest power of two that is not more than
  /// wanted or than the device allows. (No wave of a GPU has more than 64 work-items.)
  /// @throws cl::Error; Error if the device cannot run it.
  [[nodiscard]] SizedKernel sized_kernel(const cl::Program& program, const char* name,
                                         std::size_t wanted = 64) const;

  /// Sets all words of a part of a buffer, in queue() or in another queue of this context. (Not by
  /// clEnqueueFillBuffer, which some drivers do not do reliably.)
  /// @param first, count Of words.
  /// @param event Is set to that of the command, unless it is null.
  /// @throws cl::Error, Error
  void fill(const cl::Buffer& buffer, cl_uint value, std::size_t first, std::size_t count,
            cl::Event* event = nullptr) const {
    fill(queue_, buffer, value, first, count, event);
  }
  void fill(const cl::CommandQueue& queue, const cl::Buffer& buffer, cl_uint value, std::size_t first,
            std::size_t count, cl::Event* event = nullptr) const;

  /// Runs a part of an update. If that fails, waits until the queue has completed all commands, so that
  /// nothing uses the memory of the update any more, except commands in a second queue.
  /// @throws Error instead of cl::Error, and other exceptions of the function.
  template <class Function>
  decltype(auto) guard(Function&& function) const {
    return translate_errors(opened_->label, [&]() -> decltype(auto) {
      try {
        return std::forward<Function>(function)();
      } catch (...) {
        wait_if_possible(queue_);
        throw;
      }
    });
  }

 private:
  /// Bytes of buffers. A driver may free a buffer in another thread, and after the context is destroyed.
  struct Memory {
    std::atomic<std::size_t> device{0};
    std::atomic<std::size_t> pinned{0};
    std::size_t device_peak = 0;
  };

  [[nodiscard]] cl::Buffer create(std::size_t bytes, cl_mem_flags flags) const;
  [[nodiscard]] cl::Buffer counted(cl::Buffer buffer, std::size_t bytes,
                                   std::atomic<std::size_t> Memory::*counter) const;

  void open(const cl::CommandQueue& queue, std::optional<Tuning> tuning);
  void test_device();
  [[nodiscard]] Tuning suitable_tuning() const;
  [[nodiscard]] bool has_waves_of_64() const;
  [[nodiscard]] std::size_t largest_group(const cl::Kernel& kernel) const;
  [[nodiscard]] cl_ulong local_memory(const cl::Kernel& kernel) const;

  std::shared_ptr<OpenedDevice> opened_;
  OpenedDevice::Findings findings_;
  cl::CommandQueue queue_;
  bool owns_queue_ = false;
  Tuning tuning_ = Tuning::cpu;
  mutable CompileHandler on_compile_;  // empty once it was called
  mutable SizedKernel fill_;           // built when it is first needed
  std::shared_ptr<Memory> memory_ = std::make_shared<Memory>();
  std::shared_ptr<const void> life_ = std::make_shared<char>();
};

/// Makes an object that works on a device. If the device runs a kernel only in smaller work-groups, for
/// instance because it has too few registers, makes the object again with the tuning for CPUs.
/// @param make Called with the tuning, if any, for the constructor of a Context.
/// @throws Exceptions of `make`.
template <class Make>
auto make_tuned(const Make& make) {
  try {
    return make(std::optional<Tuning>());
  } catch (const GroupTooLarge&) {
    return make(std::optional(Tuning::cpu));
  }
}

}  // namespace broadcl::opencl
