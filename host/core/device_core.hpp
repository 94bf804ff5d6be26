#pragma once

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>

#include <broadcl/export.h>
#include <broadcl/opencl.hpp>

#include "base/non_copyable.hpp"
#include "engines/engine.hpp"
#include "engines/search.hpp"
#include "engines/source.hpp"
#include "opencl/context.hpp"
#include "opencl/process.hpp"
#include "opencl/profiler.hpp"
#include "opencl/tuning.hpp"

namespace broadcl {

/// What is behind a DeviceBroadPhase, whose functions of the same names say what these do.
class BROADCL_API DeviceCore : NonCopyable {
 public:
  using Boxes = DeviceBroadPhase::Boxes;
  using PairBuffer = DeviceBroadPhase::PairBuffer;
  using Result = DeviceBroadPhase::Result;
  using ChangeBuffers = DeviceBroadPhase::ChangeBuffers;

  DeviceCore(cl_command_queue queue, const DeviceBroadPhase::Config& config,
             std::optional<opencl::Tuning> tuning);
  ~DeviceCore();

  /// What begin() throws for boxes before it does anything.
  void refuse_invalid(const Boxes& boxes) const;
  void begin(const Boxes& boxes);
  /// Waits for the update that begin() started. It takes effect by commit(), or not at all if abandon() or
  /// begin() follows.
  /// @throws As finish().
  void complete();
  Result commit() noexcept;  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  /// Ends an update that was begun, if there is one, as if it had failed.
  void abandon() noexcept;
  Result finish() {
    complete();
    return commit();
  }

  void reserve(std::size_t boxes, std::size_t pairs, bool filters);
  void shrink();
  void set_exclusions(std::span<const Pair> pairs);
  void enqueue(const Boxes& boxes, const ChangeBuffers& changes);
  PairBuffer pairs();

  /// Reads a buffer of the caller from `offset` on. Waits for the queue.
  /// @throws Error
  void read(cl_mem buffer, std::size_t offset, std::span<std::byte> to) const;

  [[nodiscard]] MemoryUse memory() const noexcept;
  [[nodiscard]] const opencl::Context& context() const noexcept { return context_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profiler_.stages(); }

 private:
  /// For what enqueue() has memory.
  struct Reservation {
    std::size_t boxes = 0, pairs = 0;
    bool filters = false;
  };

  /// Calls a function as Context::guard() does. If it fails, it may have lost memory that was reserved.
  template <class Function>
  std::invoke_result_t<const Function&> guard_reservation(const Function& function);
  void fulfil(const Reservation& wanted);
  void refuse_in_flight(const std::string& call) const;
  /// Finds out which of the updates by enqueue() are complete.
  void settle();

  void reserve(Frame& frame, std::size_t boxes, bool filters) const;
  /// Copies the objects to a frame, unless that shares the memory of the other one.
  void copy(const Frame& from, Frame& to) const;

  void check(const ChangeBuffers& changes, const Boxes& boxes) const;
  void check(const Boxes& boxes) const;
  void check_set(const std::string& what, cl_mem buffer, std::size_t count, std::size_t offset,
                 std::size_t stride) const;
  /// Throws for a buffer of another context, or one that is too small for this many items.
  void check_buffer(const std::string& what, cl_mem memory, std::size_t count, std::size_t offset,
                    std::size_t stride, std::size_t size) const;

  /// The search of the caller's objects, which are still to be gathered.
  Search search_of(const Boxes& boxes);

  opencl::Context context_;
  opencl::Profiler profiler_;
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<Source> source_;
  cl::Buffer pairs_;
  // In the format of kernels/filter.h: for the next updates, and of the last update that is known to be
  // complete.
  cl::Buffer exclusions_, complete_exclusions_;
  bool in_flight_ = false;
  Engine::Completed completed_;
  Reservation reserved_;
  bool must_reserve_again_ = false;
  // Boxes of the first set: in the updates until now, and in the one that was begun.
  std::optional<std::size_t> first_count_;
  std::size_t begun_first_count_ = 0;
  std::size_t incomplete_ = 0;  // incomplete updates by enqueue() since the last result
};

using DeviceCorePointer = std::unique_ptr<DeviceCore, opencl::DeleteUnlessForked>;
/// @throws As the constructor of DeviceBroadPhase.
[[nodiscard]] BROADCL_API DeviceCorePointer make_device_core(cl_command_queue queue,
                                                             const DeviceBroadPhase::Config& config);

}  // namespace broadcl
