#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

/// For boxes that are already on an OpenCL device: pairs and their changes stay there too. Only this header
/// exposes OpenCL.

#ifdef __APPLE__
#include <OpenCL/opencl.h>
#else
#include <CL/cl.h>
#endif

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <broadcl/export.h>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

/// A BroadPhase for boxes that are on a device, where the caller also needs the pairs. It works in the
/// caller's context and queue; only counts come to the host.
///
/// Object k is the box at index k, the same object in every update. Every update tests all boxes.
///
/// Not synchronised: only one thread at a time may use an object, and nothing else may use its queue during a
/// call. Different objects are independent of each other. Movable, not copyable; an object that was moved
/// from may only be destroyed or assigned to. In a process that is forked after OpenCL was used, an object
/// may only be destroyed; other functions throw an Error.
class BROADCL_API DeviceBroadPhase {
 public:
  struct Config {
    std::string algorithm = "auto";  ///< "auto", "brute-force" or "tiles".
    bool profile = false;            ///< Measure stages on the device: the queue must have profiling enabled.
    CompileHandler on_compile{};     ///< See broadcl::Config.
    std::size_t threads = 0;         ///< See broadcl::Config; only a MpiDeviceBroadPhase has work for them.
    Executor executor{};             ///< Likewise.
  };

  /// The second of two sets of boxes, of the same kind as the first.
  struct SecondSet {
    cl_mem buffer = nullptr;  ///< Like Boxes::buffer; null if there is no second set.
    std::size_t count = 0;
    std::size_t offset = 0;
    std::size_t stride = 0;
  };

  /// Boxes of the caller, in a buffer of the queue's context. They are only read, by commands that begin() or
  /// enqueue() enqueues. Bounds may be infinite; a box that is empty (lower > upper) or has a NaN bound
  /// overlaps nothing.
  struct Boxes {
    cl_mem buffer = nullptr;   ///< Floats: lower x, y, z, upper x, y, z of each box.
    std::size_t count = 0;     ///< Number of boxes.
    std::size_t offset = 0;    ///< Of the first box, in bytes, a multiple of 4.
    std::size_t stride = 0;    ///< From each box to the next, in bytes, a multiple of 4; 0: without gaps.
    cl_mem filters = nullptr;  ///< One Filter per box, also of the queue's context; or null: all may pair.
    /// Whether the filters have different worlds. Affects only speed: without it, worlds are compared only
    /// for pairs whose boxes overlap.
    bool worlds = false;
    /// If not 0, changes are sorted by world first: 0 .. ordered_worlds-1, then all others. A pair with an
    /// object of all worlds counts as one of the other object's world; pairs of two such objects come last.
    std::size_t ordered_worlds = 0;
    /// If there is a second set, only pairs of a box of the first with a box of the second are found, and
    /// nothing is tested inside a set: `a` is an index in the first set, `b` in the second, and pairs are
    /// sorted by b, then by a. Filters are then those of the first set followed by those of the second; only
    /// their body and world count. Whether there is a second set, and then the number of boxes of the first,
    /// must be the same in every update: give empty boxes for objects that are gone. In the index of an
    /// invalid box, the second set follows the first.
    SecondSet second{};
  };

  /// Pairs in canonical order, in the layout of Pair. The buffer belongs to this object and stays unchanged
  /// until its next update; commands that are enqueued to the same queue afterwards find it filled.
  struct PairBuffer {
    cl_mem buffer = nullptr;
    std::size_t count = 0;
    /// If pairs are sorted by world, Boxes::ordered_worlds + 2 uint32: for each world the index at which its
    /// pairs begin, then the index at which all others begin, then the count. Otherwise null.
    cl_mem offsets = nullptr;
  };

  /// What changed since the last update.
  struct Result {
    PairBuffer added;
    PairBuffer removed;
    std::size_t pair_count = 0;                  ///< How many overlap now.
    std::size_t invalid_boxes = 0;               ///< Boxes with a NaN bound. They overlap nothing.
    std::optional<std::uint32_t> first_invalid;  ///< The index of the first of these.
    /// How many updates that enqueue() enqueued since the last update() or finish() are incomplete, because
    /// something did not fit. This result includes their changes.
    std::size_t incomplete = 0;
  };

  /// The caller's buffers, of the queue's context, for the changes of an update by enqueue().
  struct ChangeBuffers {
    cl_mem added = nullptr;    ///< For `capacity` pairs, in the layout of Pair.
    cl_mem removed = nullptr;  ///< Likewise.
    std::size_t capacity = 0;  ///< At least 1.
    /// For four uint32: the numbers of added pairs, of removed pairs, and of all pairs that overlap now; and
    /// 1 if the update is incomplete, otherwise 0.
    cl_mem counts = nullptr;
    cl_mem added_offsets = nullptr;    ///< As PairBuffer::offsets, if Boxes::ordered_worlds is not 0.
    cl_mem removed_offsets = nullptr;  ///< Likewise.
  };

  /// Builds the kernels.
  /// @param queue Must be in order. Retained; the object uses its context and device.
  /// @throws Error for a null or out-of-order queue, for one without profiling if Config::profile is set, for
  /// another algorithm, and if OpenCL fails.
  explicit DeviceBroadPhase(cl_command_queue queue);
  DeviceBroadPhase(cl_command_queue queue, const Config& config);
  /// Does not wait. Wait for the queue before the process ends: some drivers crash otherwise.
  ~DeviceBroadPhase();
  DeviceBroadPhase(DeviceBroadPhase&&) noexcept;
  DeviceBroadPhase& operator=(DeviceBroadPhase&&) noexcept;

  /// Finds every pair of overlapping boxes whose filters allow it; objects beyond the last box no longer
  /// exist. The same as begin() and finish(); waits for the queue once, for the counts.
  /// @throws Error if the device fails or its memory is exhausted, and for a buffer that is null, too small
  /// or of another context; std::bad_alloc. The known pairs are then as before, and the call may be repeated.
  Result update(const Boxes& boxes);

  /// Enqueues an update, makes the device start, and returns at once. (If enqueue() did the last update,
  /// waits for that first.) Commands enqueued to the same queue afterwards may overwrite boxes and filters.
  /// @throws Error as update() does, and if an update was begun already.
  void begin(const Boxes& boxes);

  /// Waits for the update that begin() started.
  /// @throws Error as update() does, and if no update was begun. An update that was begun is then over.
  Result finish();

  /// Reserves memory for updates by enqueue().
  /// @param boxes Largest number of boxes.
  /// @param pairs Largest number of pairs that overlap at a time.
  /// @param filters Whether there will be filters or a second set.
  /// @throws Error as update() does, and between begin() and finish(). After an error on the device, or for
  /// sizes that it does not allocate, nothing is reserved.
  void reserve(std::size_t boxes, std::size_t pairs, bool filters = false);

  /// Gives back memory that the boxes and pairs of the last update do not need, for instance after an update
  /// with far more pairs than usual; nothing does so by itself. Also gives back what reserve() reserved: call
  /// it again before enqueue(). The buffers of the last Result and of pairs() become invalid. Waits for the
  /// queue. The next updates take longer, until buffers have grown again.
  /// @throws Error as update() does, and between begin() and finish(); std::bad_alloc. Nothing has changed
  /// then.
  void shrink();

  /// Replaces the list of pairs of indices that are never reported, whatever their boxes and filters. For
  /// these indices, a second set follows the first. Initially the list is empty. Waits for the queue.
  /// @param pairs In any order; copied.
  /// @throws Error as update() does, for a pair of an index with itself, and between begin() and finish();
  /// std::bad_alloc. The old list is then still in effect.
  void set_exclusions(std::span<const Pair> pairs);

  /// Enqueues an update that writes its changes, in canonical order, to buffers of the caller, for commands
  /// that are enqueued after it. Does not wait for the device, except after a call that failed. Memory must
  /// have been reserved.
  ///
  /// If more pairs overlap than was reserved, if more changed than the buffers hold, or if more than 4,096
  /// changes have the same b (or the same world, if changes are sorted by world), the update is incomplete:
  /// it and all updates that are enqueued after it change nothing, neither the known pairs nor the boxes of
  /// the last update. The next waiting call (update(), begin() or pairs()) waits for the queue and continues
  /// from the last complete update. Invalid boxes overlap nothing, and are not counted.
  /// @throws Error as update() does, between begin() and finish(), and if reserve() was not called for as
  /// many boxes (of both sets together), for as many as there are ordered worlds, or, if there are filters or
  /// a second set, with filters. Then there is no update.
  void enqueue(const Boxes& boxes, const ChangeBuffers& changes);

  /// All pairs as of the last update: enqueues the commands that sort them. The buffer is valid until the
  /// next call.
  /// @throws Error as update() does, and between begin() and finish().
  PairBuffer pairs();

  /// The device in use. Owned by this object.
  [[nodiscard]] const Device& device() const noexcept;

  /// OpenCL memory of this object, without the caller's buffers. Buffers grow with boxes and pairs; most
  /// shrink only by shrink().
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update, with device times if Config::profile is set and enqueue() did not do it.
  /// Valid until the next update.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl

#endif
