#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <broadcl/pair.hpp>

#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"
#include "opencl/radix_sort.hpp"
#include "opencl/scan.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// The list of all pairs, and what changes in it in each frame, on the device: kernels/delta.h,
/// kernels/delta.cl.
///
/// Algorithms that find pairs share it. The list grows as needed: no pair is dropped.
class PairDelta {
 public:
  /// What a frame needs.
  struct Frame {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    Search search;
    /// Enqueues what puts every new pair to the sink; called again with a larger sink where they did not fit.
    std::function<void()> find;
    bool stays_on_device = false;  ///< Whether finish_on_device() is to end the frame.
  };

  /// What changed, each list in canonical order, in buffers that stay as they are until the next frame.
  struct OnDevice {  // NOLINT(bugprone-exception-escape): as above
    cl::Buffer added;
    std::size_t added_count = 0;
    cl::Buffer removed;
    std::size_t removed_count = 0;
    std::size_t found = 0;  ///< Pairs of this frame.
  };

  /// @param context, profiler Must outlive this object.
  PairDelta(const opencl::Context& context, opencl::Profiler& profiler);

  /// Enqueues a frame.
  /// @throws cl::Error, Error; the pairs of the last frame are then still known.
  void begin(Frame frame);
  /// Waits for it and brings its changes to the host. Waits once; again only where the list was too small or
  /// more pairs changed than usual.
  /// @throws cl::Error, Error; the pairs of the last frame are then still known.
  Delta finish();
  /// Waits for the counts and enqueues what leaves the changes on the device.
  /// @throws cl::Error, Error; the pairs of the last frame are then still known.
  OnDevice finish_on_device();

  /// Sets a kernel's PAIR_SINK_PARAMETERS, from the given index on. Between begin() and finish() only.
  void set_sink(cl::Kernel& kernel, cl_uint first) const;

  /// All pairs of the last frame.
  [[nodiscard]] std::vector<Pair> pairs() const;
  /// Enqueues what puts them into a new buffer, in canonical order.
  [[nodiscard]] cl::Buffer sorted_pairs() const;
  [[nodiscard]] std::size_t pair_count() const noexcept { return last_.found; }
  /// What kernels counted as COUNT_WORK in the last frame.
  [[nodiscard]] std::size_t work() const noexcept { return work_; }
  /// Frames that have ended.
  [[nodiscard]] std::size_t frames() const noexcept { return frames_; }

 private:
  struct Counts {
    std::size_t found = 0;
    std::size_t added = 0;
    std::size_t removed = 0;
    std::size_t work = 0;
    bool is_unordered = false;  // left to be sorted
  };
  /// The pairs of a frame.
  struct List {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl_uint capacity = 0;
    cl_uint found = 0;
    cl::Buffer pairs;
  };

  [[nodiscard]] List make_list(std::size_t capacity) const;
  [[nodiscard]] cl::Buffer buffer(std::size_t bytes) const;
  void reserve(std::size_t capacity);
  void reserve_result(std::size_t changes);
  [[nodiscard]] std::size_t bucket_count() const;
  void reserve_buckets();
  void reserve_scattered(std::size_t changes);
  void enqueue();
  void enqueue_keep();
  /// Brings the counts and the first changes to the host.
  void enqueue_read(std::size_t changes);
  void wait();
  /// Waits until all pairs fit, and returns how many there are.
  Counts settle();
  /// This frame becomes the last one.
  void commit(const Counts& counts);
  /// As they must be when a frame begins.
  void clear_counts();
  /// Puts the first n pairs of a buffer in canonical order.
  void sort(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& scratch) const;
  void sort_lists(const cl::Buffer& added, const Counts& counts);
  void copy_added(const Counts& counts, const cl::Buffer& to) const;
  void sort_changes(const Counts& counts);
  void enqueue_order_few();
  void enqueue_order_many();
  [[nodiscard]] const cl_uint* counts() const;
  [[nodiscard]] std::span<Pair> changes(std::size_t total) const;

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  mutable opencl::RadixSort sort_;  // changes only what it sorts
  mutable opencl::Scan scan_;
  cl::Kernel keep_, order_few_, order_count_, order_scatter_, order_place_;
  Frame frame_;
  List now_, last_;
  List next_;                         // for the next frame, where this one needed more room than the last
  std::array<cl::Buffer, 2> counts_;  // of this frame and of the next, in turn
  std::size_t turn_ = 0;
  cl::Buffer removed_;           // as many as the last frame had pairs
  cl::Buffer added_;             // in order, where they stay on the device
  opencl::SharedBuffer result_;  // counts, added, removed
  cl::Event read_;               // when it is the host's again
  bool is_half_done_ = false;    // a frame began and did not end
  std::size_t slots_ = 0;        // of the last frame
  std::size_t expected_ = 0;     // changes read together with the counts
  std::size_t room_ = 0;         // for changes in result_
  bool many_ = false;            // changes are ordered by buckets
  cl::Buffer buckets_;           // two a slot
  std::size_t bucket_capacity_ = 0;
  cl::Buffer scattered_;  // changes by bucket
  std::size_t scattered_capacity_ = 0;
  std::size_t work_ = 0;
  std::size_t frames_ = 0;
  std::size_t last_changes_ = 0;
  std::size_t last_longest_ = 0;  // the longer of added and removed
};

}  // namespace broadcl
