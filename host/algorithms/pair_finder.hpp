#pragma once

#include <cstddef>

#include "algorithms/pair_delta.hpp"
#include "algorithms/search.hpp"
#include "algorithms/source.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The part of an algorithm that finds pairs on the device.
class PairFinder {
 public:
  PairFinder() = default;
  virtual ~PairFinder() = default;
  PairFinder(const PairFinder&) = delete;
  PairFinder& operator=(const PairFinder&) = delete;
  PairFinder(PairFinder&&) = delete;
  PairFinder& operator=(PairFinder&&) = delete;

  /// Enqueues the kernels that prepare a search: they gather the objects that are still to be gathered, and
  /// count those that are invalid in the counts of the sink.
  /// @throws cl::Error, Error
  virtual void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    if (search.source != nullptr) search.source->gather(search.now, sink.counts(), profiler);
  }

  /// Whether find() can keep the pairs of the last frame besides, if the sink leaves that to it.
  [[nodiscard]] virtual bool can_keep(const Search& /*search*/) const { return false; }

  /// Enqueues the kernels that append every pair that was not a pair in the last frame to the sink, each
  /// once. May be called again for the same search if the sink was too small.
  /// @throws cl::Error, Error
  virtual void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) = 0;

  /// Whether find() gave up, as what it counted tells: what build() prepared was hopelessly out of date.
  [[nodiscard]] virtual bool gave_up(const PairDelta::Counts& /*counts*/) const { return false; }

  /// Enqueues the kernels that prepare the same search, of objects that have been gathered, so that find()
  /// does not give up again.
  /// @throws cl::Error, Error
  virtual void rebuild(const Search& /*search*/, const PairDelta& /*sink*/, opencl::Profiler& /*profiler*/) {}

  /// Forgets what was derived from boxes of earlier frames: some of them never came to be.
  virtual void forget() noexcept {}

  /// The work that find() is expected to do, in units of the finder's own, each of which takes about equally
  /// long.
  [[nodiscard]] virtual double expected_work(const Search& search, const PairDelta& sink) = 0;

  /// As Algorithm::expected_seconds().
  [[nodiscard]] virtual double expected_seconds(std::size_t /*slots*/, std::size_t /*changed*/) const {
    return 0;
  }
};

}  // namespace broadcl
