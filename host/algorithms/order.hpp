#pragma once

#include <array>
#include <cstddef>
#include <memory>

#include <broadcl/pair.hpp>

#include "algorithms/frame.hpp"
#include "algorithms/pair_delta.hpp"
#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"
#include "opencl/radix_sort.hpp"
#include "opencl/scan.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// Sorts the changes of a frame into canonical order, in buffers that later frames reuse, and copies the
/// counts, and the changes if the target is the host, to the host: kernels/order.cl.
class Order {
 public:
  /// Where the changes are needed.
  enum class Target { host, device };

  /// @param context, profiler, frames Must outlive this object.
  /// @throws cl::Error, Error
  Order(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames, Target target);

  /// The destination of a frame that the caller does not wait for: buffers of the caller for the changes,
  /// each for `capacity` pairs, and for the counts, as kernels/order.cl reports them.
  struct Report {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer added{}, removed{}, counts{};
    std::size_t capacity = 0;
    cl::Buffer added_offsets{}, removed_offsets{};  ///< Where worlds begin, if changes are ordered by world.
  };

  /// Starts a frame: chooses a way to sort, by how much changed in the last frame, and grows the buffers.
  /// @throws cl::Error, Error
  void begin(const Search& search);
  /// Starts a frame that the caller does not wait for, with the memory that reserve_ahead() reserved.
  /// @throws cl::Error, Error
  void begin(const Search& search, const Report& report);
  /// Reserves memory for such frames.
  /// @throws cl::Error, Error; nothing is reserved then.
  void reserve_ahead(std::size_t slots, std::size_t pairs);
  /// Enqueues the commands that sort the changes of a frame and, if the caller waits for it, read them.
  /// @param tag Of the frame: see PairDelta.
  /// @throws cl::Error
  void enqueue(const PairDelta& delta, cl_uint tag);
  /// Waits for these commands.
  /// @throws cl::Error
  [[nodiscard]] PairDelta::Counts wait(const PairDelta& delta);
  /// Completes the sorting and reading if more changed than was expected. All pairs must have fitted.
  /// Afterwards the functions below return the changes.
  /// @returns Whether the kernels had sorted all changes already.
  /// @throws cl::Error, Error
  bool complete(const PairDelta& delta, const PairDelta::Counts& counts);
  /// The frame succeeded.
  void commit(const PairDelta::Counts& counts) noexcept;

  /// The changes of the last frame on the host. They stay unchanged until the frame after the next begins,
  /// and as long as the Delta or a copy of it exists.
  [[nodiscard]] Delta on_host(const PairDelta::Counts& counts) const noexcept;
  /// The changes of the last frame on the device, until the next begins.
  [[nodiscard]] const cl::Buffer& added() const noexcept { return added_.get(); }
  [[nodiscard]] const cl::Buffer& removed() const noexcept { return removed_.get(); }
  /// Where worlds begin in these, if they are sorted by world; otherwise null.
  [[nodiscard]] const cl::Buffer& added_offsets() const noexcept { return added_offsets_.get(); }
  [[nodiscard]] const cl::Buffer& removed_offsets() const noexcept { return removed_offsets_.get(); }

  /// Enqueues the commands that sort pairs of slots into canonical order.
  /// @param slots Greater than every slot of the pairs.
  /// @param scratch As large as `pairs`; overwritten.
  /// @param stage To which the commands belong; null if to none.
  /// @throws cl::Error
  void sort(const cl::Buffer& pairs, std::size_t n, std::size_t slots, const cl::Buffer& scratch,
            opencl::Profiler::Scope* stage = nullptr);
  /// Enqueues the command that replaces slots of the second set by indices in that set, if the last search
  /// was of two sets.
  /// @throws cl::Error
  void renumber(const cl::Buffer& pairs, std::size_t n) {
    if (second_set_ > 0) renumber(pairs, n, {}, 0, {}, n, nullptr);
  }

 private:
  [[nodiscard]] opencl::SharedBuffer& result() noexcept { return frames_.now.result.get(); }
  [[nodiscard]] std::size_t allocated() const noexcept;
  void set_search(const Search& search);
  void reserve_result(std::size_t changes);
  void report_to_own_lists();
  void enqueue_few(const PairDelta& delta, cl_uint tag, cl::Event* event);
  void enqueue_many(const PairDelta& delta, cl_uint tag, cl::Event* event, opencl::Profiler::Scope& stage);
  cl_uint set_changes(cl::Kernel& kernel, const PairDelta& delta, cl_uint tag) const;
  void set_results(cl::Kernel& kernel, cl_uint first, const PairDelta& delta);
  void read(std::size_t changes);
  void sort_changes(const PairDelta& delta, const PairDelta::Counts& counts);
  void sort_by_world(const cl::Buffer& pairs, std::size_t n, const cl::Buffer& filters,
                     opencl::Profiler::Scope& stage);
  void enqueue_offsets(const PairDelta::Counts& counts, opencl::Profiler::Scope& stage);
  void renumber(const cl::Buffer& added, std::size_t added_count, const cl::Buffer& removed,
                std::size_t removed_count, const cl::Buffer& counts, std::size_t pairs,
                opencl::Profiler::Scope* stage);
  void set_buckets();
  void reserve_buckets(std::size_t count);

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  Frames& frames_;
  Target target_;
  bool was_bucket_too_large_ = false;  // in some frame
  std::size_t few_;                    // changes of a list, at most, that are compared each with every other
  opencl::RadixSort sort_;
  opencl::Scan scan_;
  cl::Kernel few_kernel_;
  opencl::SizedKernel count_, scatter_, place_, offsets_, world_keys_, pick_, renumber_;
  opencl::GrowingBuffer added_, removed_;  // if they are wanted on the device, or while they are sorted
  opencl::GrowingBuffer added_offsets_, removed_offsets_;  // of worlds in these
  opencl::GrowingBuffer bucket_counts_, buckets_;          // of both lists: sizes, and where they begin
  opencl::GrowingBuffer scattered_;                        // changes by bucket; pairs while they are sorted
  std::size_t zeros_ = 0;                                  // at the beginning of bucket_counts_
  cl::Event ready_;  // after which the host may read this frame's result; not if it waits for the whole queue

  // Of this frame.
  bool many_ = false;  // changes are ordered by buckets
  Report report_;      // to the caller, or to the lists above
  bool is_awaited_ = true;
  std::size_t capacity_ = 0;  // changes that there is memory for
  std::size_t room_ = 0;      // those of one list
  std::size_t expected_ = 0;  // changes that are read together with the counts
  std::size_t slots_ = 0;     // greater than every slot of the pairs
  std::size_t buckets_of_list_ = 0;
  std::size_t worlds_ = 0;   // by which changes are ordered, or 0
  cl_uint bucket_bits_ = 0;  // a bucket has the pairs of 2^bucket_bits_ slots
  cl_uint second_set_ = 0;   // its first slot, or 0
  cl::Buffer filters_, last_filters_;

  // Of the last frame.
  std::size_t last_changes_ = 0;
  std::size_t last_longest_ = 0;    // the longer of added and removed
  std::size_t longest_before_ = 0;  // that of the frame before
  std::size_t last_wanted_ = 0;     // the number of changes to have memory for
};

}  // namespace broadcl
