#pragma once

/// Boxes that lie on an OpenCL device already, pairs and their changes left there. Only this header shows
/// OpenCL.

#include <CL/cl.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

/// A BroadPhase for callers who have their boxes on a device and go on working there. It works in the
/// caller's context and queue; only counts come to the host.
///
/// Object k is the box at place k, in every update the same object. Every update tests all of them.
///
/// Not synchronised: one thread at a time may use an object. Can be moved, not copied.
class DeviceBroadPhase {
 public:
  struct Config {
    std::string algorithm = "auto";  ///< A name of algorithms() that finds pairs on the device.
    bool profile = false;            ///< Measure stages on the device: the queue must have profiling enabled.
  };

  /// Boxes of the caller, in a buffer of the queue's context. Only read, and only by commands that begin()
  /// enqueues.
  struct Boxes {
    cl_mem buffer = nullptr;   ///< Floats: lower x, y, z, upper x, y, z of each box.
    std::size_t count = 0;     ///< Number of boxes.
    std::size_t offset = 0;    ///< Of the first box, in bytes, a multiple of 4.
    std::size_t stride = 24;   ///< From each box to the next, in bytes, a multiple of 4.
    cl_mem filters = nullptr;  ///< A Filter for each box, or null: all pair.
    bool worlds = false;       ///< Whether the filters have different worlds.
  };

  /// Pairs in canonical order, as Pair lays them out. The buffer is this object's and stays as it is until
  /// its next update; commands that are enqueued to the same queue find it filled.
  struct PairBuffer {
    cl_mem buffer = nullptr;
    std::size_t count = 0;
  };

  /// What changed since the last update.
  struct Result {
    PairBuffer added;
    PairBuffer removed;
    std::size_t pairs = 0;        ///< How many overlap now.
    std::size_t bad_boxes = 0;    ///< Boxes with a NaN bound. They overlap nothing.
    std::uint32_t first_bad = 0;  ///< The place of the first of these.
  };

  /// Builds the kernels.
  /// @param queue In order. Retained; its context and device are those that are used.
  /// @throws Error for an out-of-order queue, an unknown algorithm or one that works on the host, and for
  /// whatever fails in OpenCL.
  explicit DeviceBroadPhase(cl_command_queue queue);
  DeviceBroadPhase(cl_command_queue queue, const Config& config);
  ~DeviceBroadPhase();
  DeviceBroadPhase(DeviceBroadPhase&&) noexcept;
  DeviceBroadPhase& operator=(DeviceBroadPhase&&) noexcept;

  /// Finds every pair of overlapping boxes that their filters let pair. The same as begin() and finish();
  /// waits for the queue once, for the counts.
  /// @throws Error when the device fails or memory is exhausted, and for a buffer that is too small; the
  /// known pairs are then as before.
  Result update(const Boxes& boxes);

  /// Enqueues an update behind what is in the queue, has the device start, and returns at once.
  /// @throws Error as update() does, and where one was begun already.
  void begin(const Boxes& boxes);

  /// Waits for the update that was begun.
  /// @throws Error as update() does, and where none was begun.
  Result finish();

  /// Enqueues what puts all pairs as of the last update in order. Valid until the next call or update.
  /// @throws Error as update() does, and between begin() and finish().
  PairBuffer pairs();

  /// The device in use. Owned by this object.
  [[nodiscard]] const Device& device() const noexcept;

  /// The stages of the last update. Valid until the next.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl
