#pragma once

#include <cstddef>

#include "base/non_copyable.hpp"
#include "engines/pair_delta.hpp"
#include "engines/search.hpp"
#include "engines/source.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The part of an algorithm that finds pairs on the device.
class PairFinder : NonCopyable {
 public:
  virtual ~PairFinder() = default;

  /// May enqueue the kernels that do not need the boxes of this search, which may not be there yet.
  /// @throws cl::Error, Error
  virtual void begin(const Search& /*search*/, const PairDelta& /*sink*/, opencl::Profiler& /*profiler*/) {}

  /// Enqueues the kernels that prepare the search. Called after begin().
  /// If the search has a source, they or those of find() gather the objects, and count invalid ones in the
  /// counts of the sink.
  /// @throws cl::Error, Error
  virtual void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    if (search.source != nullptr) search.source->gather(search.now, sink.counts(), profiler);
  }

  /// Whether find() is to keep the pairs of the last frame, too, because that takes less time than a kernel
  /// for that alone. Called after build().
  [[nodiscard]] virtual bool keeps(const Search& /*search*/, const PairDelta& /*sink*/) const {
    return false;
  }

  /// Enqueues the kernels that append every pair that was not a pair in the last frame to the sink, each
  /// once. May be called again for the same search if the sink was too small.
  /// @throws cl::Error, Error
  virtual void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) = 0;

  /// Whether, according to its counts, find() gave up, or did not find all pairs, because the boxes had moved
  /// too far for what build() prepared. Called once per find().
  [[nodiscard]] virtual bool gave_up(const PairDelta::Counts& /*counts*/) { return false; }

  /// Enqueues the kernels that prepare the same search again, more carefully: find() gives up at most once
  /// more. The objects must have been gathered.
  /// @throws cl::Error, Error
  virtual void rebuild(const Search& /*search*/, const PairDelta& /*sink*/, opencl::Profiler& /*profiler*/) {}

  /// Discards what was derived from the boxes of earlier frames, because some of these frames were
  /// incomplete.
  virtual void forget() noexcept {}

  /// As Algorithm::expected_seconds().
  [[nodiscard]] virtual double expected_seconds(std::size_t /*slots*/, std::size_t /*changed*/) const {
    return 0;
  }
};

}  // namespace broadcl
