#pragma once

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

/// A BroadPhase for callers who have their boxes on a device and go on working there. It works in the
/// caller's context and queue; only counts come to the host.
///
/// Object k is the box at index k, in every update the same object. Every update tests all of them.
///
/// Not synchronised: one thread at a time may use an object, and nothing else may use its queue meanwhile.
/// Different objects are independent of each other. Can be moved, not copied; one that was moved from may
/// only be destroyed or assigned to.
class BROADCL_API DeviceBroadPhase {
 public:
  struct Config {
    std::string algorithm = "auto";  ///< A name of algorithms() that finds pairs on the device.
    bool profile = false;            ///< Measure stages on the device: the queue must have profiling enabled.
    CompileHandler on_compile{};     ///< As broadcl::Config has it.
  };

  /// The second of two sets of boxes, of the same kind as the first.
  struct SecondSet {
    cl_mem buffer = nullptr;  ///< As Boxes::buffer; null if there is no second set.
    std::size_t count = 0;
    std::size_t offset = 0;
    std::size_t stride = 24;
  };

  /// Boxes of the caller, in a buffer of the queue's context. Only read, and only by commands that begin()
  /// enqueues. Bounds may be infinite; an empty box (lower > upper), and one with a NaN bound, overlaps
  /// nothing.
  struct Boxes {
    cl_mem buffer = nullptr;   ///< Floats: lower x, y, z, upper x, y, z of each box.
    std::size_t count = 0;     ///< Number of boxes.
    std::size_t offset = 0;    ///< Of the first box, in bytes, a multiple of 4.
    std::size_t stride = 24;   ///< From each box to the next, in bytes, a multiple of 4.
    cl_mem filters = nullptr;  ///< One Filter per box, also of the queue's context; or null: all pair.
    bool worlds = false;       ///< Whether the filters have different worlds.
    /// If not 0, changes are in order of their worlds first: 0 .. ordered_worlds-1, then all others. A pair
    /// with an object of all worlds is of the other one's world; pairs of two such objects come last.
    std::size_t ordered_worlds = 0;
    /// If there is a second set, only pairs of a box of the first with one of the second are found, and
    /// nothing is tested inside a set: `a` is an index in the first set, `b` in the second, and the order is
    /// by b, then by a. Filters are then those of the first set followed by those of the second; of theirs,
    /// body and world count. The number of boxes of the first set must be the same in every update: give
    /// empty ones for those that are gone. Invalid boxes are counted as if the second set followed the first.
    SecondSet second{};
  };

  /// Pairs in canonical order, as Pair lays them out. The buffer belongs to this object and stays unchanged
  /// until its next update; commands that are enqueued to the same queue find it filled.
  struct PairBuffer {
    cl_mem buffer = nullptr;
    std::size_t count = 0;
    /// If they are in order of worlds, Boxes::ordered_worlds + 2 uint32: the index at which the pairs of each
    /// world begin, that at which those of no such world do, and the count. Otherwise null.
    cl_mem offsets = nullptr;
  };

  /// What changed since the last update.
  struct Result {
    PairBuffer added;
    PairBuffer removed;
    std::size_t pair_count = 0;                  ///< How many overlap now.
    std::size_t invalid_boxes = 0;               ///< Boxes with a NaN bound. They overlap nothing.
    std::optional<std::uint32_t> first_invalid;  ///< The index of the first of these.
    /// How many updates that enqueue() enqueued since the last waiting call changed nothing, since something
    /// did not fit. This result has their changes, too.
    std::size_t incomplete = 0;
  };

  /// The caller's buffers, of the queue's context, for the changes of an update that nobody waits for.
  struct ChangeBuffers {
    cl_mem added = nullptr;    ///< For `capacity` pairs, as Pair lays them out.
    cl_mem removed = nullptr;  ///< Likewise.
    std::size_t capacity = 0;  ///< At least 1.
    /// For four uint32: the number of added pairs, of removed ones, and of all that overlap now; and 1 if the
    /// update is incomplete, otherwise 0.
    cl_mem counts = nullptr;
    cl_mem added_offsets = nullptr;    ///< As PairBuffer::offsets, if Boxes::ordered_worlds is not 0.
    cl_mem removed_offsets = nullptr;  ///< Likewise.
  };

  /// Builds the kernels.
  /// @param queue In order. Retained; its context and device are those that are used.
  /// @throws Error for a null or an out-of-order queue, for one without profiling if Config::profile is set,
  /// for an unknown algorithm or one that works on the host, and for whatever fails in OpenCL.
  explicit DeviceBroadPhase(cl_command_queue queue);
  DeviceBroadPhase(cl_command_queue queue, const Config& config);
  /// Waits for nothing. Wait for the queue before the process ends: not every driver bears that otherwise.
  ~DeviceBroadPhase();
  DeviceBroadPhase(DeviceBroadPhase&&) noexcept;
  DeviceBroadPhase& operator=(DeviceBroadPhase&&) noexcept;

  /// Finds every pair of overlapping boxes that their filters let pair. The same as begin() and finish();
  /// waits for the queue once, for the counts.
  /// @throws Error if the device fails or its memory is exhausted, and for a buffer that is null, too small
  /// or of another context; std::bad_alloc. The known pairs are then as before, and the next update works.
  Result update(const Boxes& boxes);

  /// Enqueues an update behind what is in the queue, makes the device start, and returns at once; unless the
  /// last one was enqueued by enqueue(): then it waits for that first.
  /// @throws Error as update() does, and if one was begun already.
  void begin(const Boxes& boxes);

  /// Waits for the update that was begun.
  /// @throws Error as update() does, and if none was begun. The update that was begun is then over.
  Result finish();

  /// Reserves memory for updates that nobody waits for.
  /// @param boxes Boxes of an update, at most.
  /// @param pairs Pairs that overlap at a time, at most.
  /// @param filters Whether there will be filters.
  /// @throws Error as update() does, and between begin() and finish().
  void reserve(std::size_t boxes, std::size_t pairs, bool filters = false);

  /// Replaces the list of pairs of indices that are never reported, whatever their boxes and filters; those
  /// of a second set are counted as if it followed the first. At first there are none. Waits for the queue.
  /// @param pairs In any order; copied.
  /// @throws Error as update() does, for a pair of an index with itself, and between begin() and finish();
  /// std::bad_alloc. The old ones then stay.
  void set_exclusions(std::span<const Pair> pairs);

  /// Enqueues an update behind what is in the queue, and its changes, in canonical order, into buffers of the
  /// caller, where commands enqueued after it find them. Never waits for the device, except after a call
  /// that failed. The first one, and the first with worlds, build kernels. Memory must have been reserved.
  ///
  /// If more pairs overlap than was reserved, if more changed than the buffers hold, or if more than 4,096
  /// changes have the same b (or the same world, if they are in order of worlds), the update is incomplete:
  /// nothing changes, neither the known pairs nor the boxes that are compared with, and so it is with all
  /// updates that are enqueued after it. The next waiting call (update(), begin() or pairs()) ends that: it
  /// waits for the queue, and goes on from the last complete update. Invalid boxes overlap nothing, and are
  /// not counted.
  /// @throws Error as update() does, and between begin() and finish(), and if there are more boxes than
  /// reserve() was told of. The update does then not take place.
  void enqueue(const Boxes& boxes, const ChangeBuffers& changes);

  /// Enqueues the commands that sort all pairs as of the last update. The buffer is valid until the next
  /// call.
  /// @throws Error as update() does, and between begin() and finish().
  PairBuffer pairs();

  /// The device in use. Owned by this object.
  [[nodiscard]] const Device& device() const noexcept;

  /// Memory of this object on the device and for it, without the caller's buffers. Buffers grow with boxes
  /// and pairs, and never shrink.
  [[nodiscard]] MemoryUse memory() const noexcept;

  /// The stages of the last update, with device times if it was waited for. Valid until the next.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl
