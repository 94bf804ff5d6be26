#pragma once

#include <array>
#include <cstddef>

#include <broadcl/pair.hpp>

#include "engines/frame.hpp"
#include "engines/kernel_layout.hpp"
#include "engines/search.hpp"
#include "opencl/context.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The list of all pairs on the device, in no particular order, and how a frame changes it: kernels/delta.h,
/// kernels/delta.cl. The list grows as needed; no pair is lost.
///
/// A frame consists of begin(), keep() and a PairFinder's find(), all enqueued; then commit() or, if the
/// pairs did not fit, all of it again with more capacity. Until commit(), the pairs of the last frame are
/// still known.
///
/// If the caller does not wait for the frame, commit_unread() assumes that it is complete. If it is not, the
/// kernels of this and of all later frames leave everything unchanged. settle() finds out how many frames
/// were complete.
class PairDelta {
 public:
  /// The counts of a frame: kernels/counts.h.
  struct Counts {
    std::size_t found = 0;  ///< Pairs of this frame.
    std::size_t added = 0;
    std::size_t removed = 0;
    std::size_t work = 0;           ///< The finder's own count.
    bool is_unordered = false;      ///< Whether the changes are still to be sorted.
    std::size_t invalid_boxes = 0;  ///< If boxes were gathered on the device.
    std::size_t first_invalid = 0;
    cl_uint displacement =
        0;  ///< The bits of a float: how far boxes moved, at most, if NearPairs measured it.
    cl_uint grown_tiles = 0;  ///< If `tiles` counted them.
  };

  /// @param context, profiler, frames Must outlive this object.
  /// @throws cl::Error, Error
  PairDelta(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames);

  /// The outcome of frames that nobody waited for.
  struct Settled {
    std::size_t frames = 0;
    std::size_t complete = 0;  ///< The first of them; the others changed nothing.
    cl_uint tag = 0;           ///< Of the last complete frame, whether it was one of them or not.
  };

  /// Takes over the pairs of the last frame of another one, which must be settled, with memory for these
  /// only. For use before the first frame.
  /// @throws cl::Error, Error
  void take(const PairDelta& other);

  /// Starts a frame: sets all counts to 0, and gives the list capacity for this many pairs, and at least for
  /// those of the last frame.
  /// @throws cl::Error, Error
  void begin(std::size_t pairs);
  /// Reserves memory for frames that the caller does not wait for, with this many pairs.
  /// @throws cl::Error, Error; nothing is reserved then.
  void reserve_ahead(std::size_t pairs);
  /// Enqueues the kernel that splits the pairs of the last frame into those that stay and those that are
  /// removed.
  /// @throws cl::Error
  void keep(const Search& search);
  /// The number of pairs of the last frame, or, if nobody has waited for that, how many there may be.
  [[nodiscard]] std::size_t most_to_keep() const noexcept;
  /// Sets a kernel's KEEP_PARAMETERS, from the given index on; returns the index after the last of them.
  /// @param keeps Whether the kernel is to do this work; otherwise buffers are null, which take less time.
  /// @throws cl::Error
  cl_uint set_keep(cl::Kernel& kernel, cl_uint first, const Search& search, bool keeps) const;
  /// Sets a kernel's KEEP_KERNEL_PARAMETERS, its last ones, from the given index on.
  /// @throws cl::Error
  void set_keep_kernel(cl::Kernel& kernel, cl_uint first, const Search& search) const;
  /// Sets a kernel's PAIR_SINK_PARAMETERS, from the given index on; returns the index after the last of them.
  /// @throws cl::Error
  cl_uint set_sink(cl::Kernel& kernel, cl_uint first, const Search& search) const;

  /// Decodes the counts that the host has read.
  [[nodiscard]] Counts counts_of(const std::byte* counts) const;
  [[nodiscard]] bool fits(const Counts& counts) const noexcept { return counts.found <= now_.capacity; }
  /// The frame succeeded: to be called before it becomes the last one. Its counts must have been read.
  /// @param tag Any number; settle() returns that of the last complete frame.
  /// @param is_next_ready Whether the kernels of kernels/order.h have prepared the counts of the next frame.
  void commit(const Counts& counts, cl_uint tag, bool is_next_ready) noexcept;
  /// The same for a frame that has been enqueued, and for which the caller does not wait.
  void commit_unread() noexcept;
  /// Waits for such frames. Afterwards the last frame is the last complete one again.
  /// @throws cl::Error
  Settled settle();
  /// @param complete How many of them were complete, modulo 2^32.
  [[nodiscard]] static Settled settled_of(std::uint64_t frames, cl_uint complete, cl_uint tag) noexcept;
  /// Whether there are such frames.
  [[nodiscard]] bool is_unsettled() const noexcept { return unread_ > 0; }
  /// Whether a frame was begun that was neither committed nor replaced by another.
  [[nodiscard]] bool was_interrupted() const noexcept { return !is_clean_; }

  /// The counts of this frame.
  [[nodiscard]] const cl::Buffer& counts() const noexcept { return frames_.now.counts; }
  /// The pairs that this frame removed.
  [[nodiscard]] const cl::Buffer& removed() const noexcept { return removed_.get(); }

  /// Enqueues the commands that copy the pairs of the last frame.
  /// @throws cl::Error
  void copy_pairs(const cl::Buffer& to) const;
  /// The number of pairs of the last frame, or of the last settled frame if some are unsettled.
  [[nodiscard]] std::size_t pair_count() const noexcept { return last_.found(); }
  /// What the finder counted as work in the last frame.
  [[nodiscard]] std::size_t work() const noexcept { return work_; }
  /// How far boxes moved in the last frame, at most, if NearPairs measured it.
  [[nodiscard]] cl_uint displacement() const noexcept { return displacement_; }
  /// Frames that have succeeded.
  [[nodiscard]] std::size_t frames() const noexcept { return frame_count_; }

  static constexpr std::size_t count_bytes = layout::COUNTS * sizeof(cl_uint);  ///< Of all counts.

 private:
  void reserve(std::size_t pairs);
  void clear_counts();
  void copy_pairs(const Frame::PairList& from, const cl::Buffer& to, std::size_t end) const;

  const opencl::Context& context_;
  opencl::Profiler& profiler_;
  Frames& frames_;
  Frame::PairList &now_, &last_;  // of these
  cl::Kernel keep_;
  opencl::GrowingBuffer removed_;  // with capacity for all pairs of the last frame
  bool is_clean_ = false;          // the counts of the next frame are ready
  cl_uint last_tag_ = 0;
  std::size_t unread_ = 0;  // frames that nobody has waited for
  std::size_t work_ = 0;
  cl_uint displacement_ = 0;
  std::size_t frame_count_ = 0;
};

}  // namespace broadcl
