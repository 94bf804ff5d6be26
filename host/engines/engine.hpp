#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <broadcl/pair.hpp>

#include "engines/algorithm.hpp"
#include "engines/frame.hpp"
#include "engines/order.hpp"
#include "engines/pair_delta.hpp"
#include "engines/pair_finder.hpp"
#include "engines/search.hpp"
#include "engines/touching.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The engine of BroadPhase and DeviceBroadPhase. It does one frame at a time, and does not depend on where
/// objects come from and where changes go.
///
/// A frame consists of prepare(), the commands that update the objects, and begin(), search() and finish(),
/// or enqueue() if the caller does not wait for the frame. If one of these fails, the pairs of the last frame
/// are still known, and the next frame starts with prepare() again.
class Engine {
 public:
  /// @param context, profiler Must outlive this object.
  /// @throws cl::Error, Error
  Engine(const opencl::Context& context, opencl::Profiler& profiler, MakePairFinder make_finder,
         Order::Target target);

  /// Another engine that continues after the last frame of this one, which must be settled, and has no memory
  /// but that for its pairs. (Not this one with less memory, because kernels own their arguments.)
  /// @throws cl::Error, Error
  [[nodiscard]] std::unique_ptr<Engine> successor() const;

  /// Must not be called while there are unsettled frames, unless the new frame will be enqueued, too.
  /// @param pairs How many to reserve memory for. If there are more, the frame runs again.
  /// @throws cl::Error, Error
  void prepare(std::size_t pairs = 0) { delta_.begin(pairs); }
  /// Enqueues what needs no new boxes.
  /// @param tag Any number; settle() returns that of the last complete frame.
  /// @throws cl::Error, Error
  void begin(Search search, cl_uint tag = 0);
  /// Enqueues the search and the reading of its results. Unless the search has a source, commands that update
  /// the objects must have been enqueued.
  /// @throws cl::Error, Error
  void search();
  /// Waits for the search. Waits again only if the lists were too small, if far more changed than in the last
  /// frame, or if the finder gave up.
  /// @throws cl::Error, Error
  PairDelta::Counts finish() {
    const Completed completed = complete();
    commit(completed);
    return completed.counts;
  }

  struct Completed {
    PairDelta::Counts counts;
    bool is_next_ready = false;
  };
  /// finish() without the end: unless commit() follows, the last frame is still the last one, as if this one
  /// had failed.
  [[nodiscard]] Completed complete();
  /// The frame succeeded, and becomes the last one.
  // NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
  void commit(const Completed& completed) noexcept;

  /// Ends the only frame of an engine, instead of finish(): returns its pairs in canonical order, without
  /// sorting its changes.
  /// @throws cl::Error, Error
  [[nodiscard]] std::vector<Pair> finish_only_search();

  /// Reserves memory for frames that the caller does not wait for, of this many slots and pairs.
  /// @throws cl::Error, Error; nothing has changed then.
  void reserve_ahead(std::size_t slots, std::size_t pairs);
  /// Enqueues the search and the commands that write its changes, in order, to the caller's buffers, and
  /// makes the device start. reserve_ahead() must have been called for as many objects. The frame is then
  /// unsettled.
  /// @throws cl::Error, Error
  void enqueue(Search search, cl_uint tag, const Report& report);
  /// Waits for all unsettled frames.
  /// @throws cl::Error
  PairDelta::Settled settle();
  [[nodiscard]] bool is_unsettled() const noexcept { return delta_.is_unsettled(); }
  /// Whether a frame failed after prepare(): unsettled frames must then be settled before the next frame.
  [[nodiscard]] bool was_interrupted() const noexcept { return delta_.was_interrupted(); }

  /// As Algorithm::expected_seconds().
  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t changed) const {
    return finder_->expected_seconds(slots, changed);
  }

  /// This frame and the last one. Callers set the objects of this one, and may ask for those of the last.
  [[nodiscard]] Frames& frames() noexcept { return frames_; }
  [[nodiscard]] const Frames& frames() const noexcept { return frames_; }
  /// The changes of the last frame, on the target.
  [[nodiscard]] const Order& changes() const noexcept { return order_; }
  /// Number of pairs as of the last frame.
  [[nodiscard]] std::size_t pair_count() const noexcept { return delta_.pair_count(); }
  /// As Algorithm::touching(), for all pairs of the last frame.
  /// @throws cl::Error, Error, std::bad_alloc
  [[nodiscard]] Touching touching(AxisSet axes);
  /// Enqueues the commands that write all pairs of the last frame, in canonical order, to a new buffer.
  /// @throws cl::Error, Error
  [[nodiscard]] cl::Buffer sorted_pairs();
  /// The same on the host.
  /// @throws cl::Error, Error
  [[nodiscard]] std::vector<Pair> pairs();

 private:
  void enqueue();
  PairDelta::Counts find();

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  MakePairFinder make_finder_;
  Order::Target target_;
  Frames frames_;
  PairDelta delta_;
  Order order_;
  std::unique_ptr<PairFinder> finder_;
  std::optional<TouchingPairs> touching_;  // once they are asked for
  Search search_;                          // of the frame that was begun
  cl_uint tag_ = 0;                        // of that frame
  std::size_t most_slots_ = 1;             // of all frames: greater than every slot of a pair
};

/// An algorithm that finds pairs on the device, for a BroadPhase.
/// @throws Error as the algorithm's constructor does.
[[nodiscard]] AlgorithmPointer make_device_algorithm(const Config& config, MakePairFinder make_finder);

}  // namespace broadcl
