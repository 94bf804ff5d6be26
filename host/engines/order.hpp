#pragma once

#include <cstddef>
#include <memory>

#include <broadcl/pair.hpp>

#include "engines/frame.hpp"
#include "engines/order_plan.hpp"
#include "engines/pair_delta.hpp"
#include "engines/search.hpp"
#include "engines/world_order.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"
#include "opencl/radix_sort.hpp"
#include "opencl/scan.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {

/// Sorts the changes of a frame into canonical order, in buffers that later frames reuse, and copies the
/// counts, and the changes if the target is the host, to the host: kernels/order.h.
class Order {
 public:
  /// Where the changes are needed.
  enum class Target { host, device };

  /// @param context, profiler, frames Must outlive this object.
  /// @throws cl::Error, Error
  Order(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames, Target target);

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
  void commit(const PairDelta::Counts& counts) noexcept { history_.commit(counts); }

  /// The changes of the last frame on the host. They stay unchanged until the frame after the next begins,
  /// and as long as the Delta or a copy of it exists.
  [[nodiscard]] Delta on_host(const PairDelta::Counts& counts) const noexcept;
  /// The changes of the last frame on the device, until the next begins.
  [[nodiscard]] const cl::Buffer& added() const noexcept { return added_.get(); }
  [[nodiscard]] const cl::Buffer& removed() const noexcept { return removed_.get(); }
  /// Where worlds begin in these, if they are sorted by world; otherwise null.
  [[nodiscard]] const cl::Buffer& added_offsets() const noexcept { return by_world_.added_offsets(); }
  [[nodiscard]] const cl::Buffer& removed_offsets() const noexcept { return by_world_.removed_offsets(); }

  /// Enqueues the commands that sort pairs of slots into canonical order.
  /// @param slots Greater than every slot of the pairs.
  /// @param scratch As large as `pairs`; overwritten.
  /// @param stage To which the commands belong; null if to none.
  /// @throws cl::Error
  void sort(const cl::Buffer& pairs, std::size_t n, std::size_t slots, const cl::Buffer& scratch,
            opencl::Profiler::Scope* stage = nullptr);
  /// Enqueues the command that replaces slots of the second set, if there are two, by indices in that set.
  /// @param second_set Its first slot, or 0 if there is none.
  /// @throws cl::Error
  void renumber(const cl::Buffer& pairs, std::size_t n, cl_uint second_set, cl::Event* event = nullptr);

 private:
  [[nodiscard]] opencl::SharedBuffer& result() noexcept { return frames_.now.result.get(); }
  void plan_buckets();
  void reserve_buckets(std::size_t count);
  void reserve_result(std::size_t changes);
  void report_to_own_lists();
  void sort_in_one_launch(const PairDelta& delta, cl_uint tag, cl::Event* event);
  void sort_by_buckets(const PairDelta& delta, cl_uint tag, cl::Event* event, opencl::Profiler::Scope& stage);
  cl_uint set_changes(cl::Kernel& kernel, const PairDelta& delta, cl_uint tag) const;
  void set_results(cl::Kernel& kernel, cl_uint first);
  void read(std::size_t changes);
  void sort_changes(const PairDelta& delta, const PairDelta::Counts& counts);

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  Frames& frames_;
  Target target_;
  opencl::RadixSort sort_;
  opencl::Scan scan_;
  WorldOrder by_world_;
  cl::Kernel small_;
  opencl::SizedKernel count_, scatter_, place_, renumber_;
  opencl::GrowingBuffer added_, removed_;  // if they are wanted on the device, or while they are sorted
  opencl::GrowingBuffer bucket_counts_, buckets_;  // of both lists: sizes, and where they begin
  std::size_t zeros_ = 0;                          // at the beginning of bucket_counts_
  opencl::GrowingBuffer scattered_;                // changes by bucket; pairs while they are sorted
  cl::Event ready_;  // after which the host may read this frame's result; not if it waits for the whole queue
  OrderPlan plan_;   // of this frame
  ChangeHistory history_;
};

}  // namespace broadcl
