#pragma once

#include <memory>
#include <vector>

#include <broadcl/pair.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/order.hpp"
#include "algorithms/pair_delta.hpp"
#include "algorithms/pair_finder.hpp"
#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// One frame, whoever brings the objects and wherever the changes go: the engine of BroadPhase and
/// DeviceBroadPhase.
///
/// prepare(), then what brings the objects up to date, then begin() and finish(). If one of them fails, the
/// pairs of the last frame are still known, and the next frame begins with prepare() again.
class Engine {
 public:
  /// @param context, profiler Must outlive this object.
  /// @throws cl::Error, Error
  Engine(const opencl::Context& context, opencl::Profiler& profiler, MakePairFinder make_finder,
         Order::Target target);

  /// @throws cl::Error, Error
  void prepare() { delta_.begin(0); }
  /// What kernels that bring the objects up to date count in: kernels/delta.h.
  [[nodiscard]] const cl::Buffer& counts() const noexcept { return delta_.counts(); }
  /// Enqueues the search of objects that are up to date, and the reading of what it finds.
  /// @throws cl::Error, Error
  void begin(Search search);
  /// Waits for it; a second time only if the lists were too small or far more changed than in the last frame.
  /// @throws cl::Error, Error
  PairDelta::Counts finish();

  /// As PairFinder::expected_work().
  [[nodiscard]] double expected_work(const Search& search) { return finder_->expected_work(search, delta_); }

  /// The changes of the last frame, as the target is.
  [[nodiscard]] const Order& changes() const noexcept { return order_; }
  /// How many pairs there are as of the last frame.
  [[nodiscard]] std::size_t pair_count() const noexcept { return delta_.pair_count(); }
  /// Enqueues what puts these, in canonical order, into a new buffer.
  /// @throws cl::Error, Error
  [[nodiscard]] cl::Buffer sorted_pairs();
  /// The same on the host.
  /// @throws cl::Error, Error
  [[nodiscard]] std::vector<Pair> pairs();

 private:
  void enqueue();

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  PairDelta delta_;
  Order order_;
  std::unique_ptr<PairFinder> finder_;
  Search search_;           // of the frame that was begun
  cl_uint last_slots_ = 0;  // of the last frame
};

/// An algorithm that finds pairs on the device, for a BroadPhase.
/// @throws Error as the algorithm's constructor does.
[[nodiscard]] std::unique_ptr<Algorithm> make_device_algorithm(const Config& config,
                                                               MakePairFinder make_finder);

}  // namespace broadcl
