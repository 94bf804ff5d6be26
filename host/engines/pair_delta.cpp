#include "engines/pair_delta.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

#include "base/pair_lists.hpp"
#include "engines/kernel_arguments.hpp"
#include "opencl/common_program.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

constexpr std::size_t least_pairs = 1 << 14;

}  // namespace

PairDelta::PairDelta(const opencl::Context& context, opencl::Profiler& profiler, Frames& frames)
    : context_(context),
      profiler_(profiler),
      frames_(frames),
      now_(frames.now.pairs),
      last_(frames.last.pairs) {
  keep_ = context.kernel(opencl::common_program(context), "delta_keep", context.launch().group);
  for (Frame* frame : {&frames.now, &frames.last}) frame->counts = context.buffer(count_bytes);
}

void PairDelta::reserve(std::size_t pairs) {
  if (pairs > most_pairs) {
    throw Error(context_.device().label() + ": more than " + std::to_string(most_pairs) +
                " pairs overlap; use fewer boxes");
  }
  removed_.reserve(context_, std::max(last_.found(), least_pairs) * sizeof(Pair), "overlapping pairs");
  if (now_.capacity >= std::max(pairs, least_pairs)) return;
  now_.capacity = 0;
  now_.buffer.reserve(context_, std::max(pairs, least_pairs) * sizeof(Pair), "overlapping pairs");
  now_.capacity = std::min(most_pairs, now_.buffer.bytes() / sizeof(Pair));
}

void PairDelta::take(const PairDelta& other) {
  last_tag_ = other.last_tag_;
  frame_count_ = other.frame_count_;
  if (other.pair_count() == 0) return;
  last_.buffer.reserve(context_, other.pair_count() * sizeof(Pair), "overlapping pairs");
  last_.capacity = std::min(most_pairs, last_.buffer.bytes() / sizeof(Pair));
  last_.kept = other.last_.kept;
  last_.added = other.last_.added;
  copy_pairs(other.last_, last_.buffer.get(), last_.capacity);
}

void PairDelta::begin(std::size_t pairs) {
  if (unread_ == 0) reserve(std::max(pairs, last_.found()));
  if (!is_clean_) clear_counts();
  is_clean_ = false;
}

void PairDelta::clear_counts() {
  opencl::Profiler::Scope stage(profiler_, "clear");
  for (const Frame* frame : {&frames_.now, &frames_.last}) {
    context_.fill(frame->counts, 0, 0, layout::COUNTS, stage.event());
  }
  const auto set = [&](std::size_t count, std::size_t value) {
    context_.fill(counts(), static_cast<cl_uint>(value), count, 1, stage.event());
  };
  set(layout::COUNT_LAST_KEPT, last_.kept);
  set(layout::COUNT_LAST_ADDED, last_.added);
  set(layout::COUNT_LAST_TAG, last_tag_);
}

void PairDelta::reserve_ahead(std::size_t pairs) {
  reserve(std::max(pairs, last_.found()));
  // Each of the two lists will be the last frame's list in turn.
  removed_.reserve(context_, std::max(now_.capacity, last_.capacity) * sizeof(Pair), "overlapping pairs");
  if (last_.capacity >= now_.capacity) return;
  Frame::PairList larger;
  larger.buffer.reserve(context_, now_.capacity * sizeof(Pair), "overlapping pairs");
  larger.capacity = now_.capacity;
  larger.kept = last_.kept;
  larger.added = last_.added;
  copy_pairs(last_, larger.buffer.get(), larger.capacity);
  last_ = std::move(larger);
}

/// Copies the kept pairs to the beginning of a list, and the others so that they end at `end`.
void PairDelta::copy_pairs(const Frame::PairList& from, const cl::Buffer& to, std::size_t end) const {
  const auto copy = [&](std::size_t first, std::size_t n, std::size_t at) {
    if (n == 0) return;
    context_.queue().enqueueCopyBuffer(from.buffer.get(), to, first * sizeof(Pair), at * sizeof(Pair),
                                       n * sizeof(Pair));
  };
  copy(0, from.kept, 0);
  copy(from.capacity - from.added, from.added, end - from.added);
}

void PairDelta::copy_pairs(const cl::Buffer& to) const {
  copy_pairs(last_, to, last_.found());
}

std::size_t PairDelta::most_to_keep() const noexcept {
  // If nobody has waited for the last frame, only an upper bound is known.
  return unread_ > 0 ? last_.capacity : last_.found();
}

cl_uint PairDelta::set_keep(cl::Kernel& kernel, cl_uint first, const Search& search, bool keeps) const {
  const cl::Buffer none;
  const bool same_filters = !keeps || search.same_filters;
  return opencl::set_arguments(
      kernel, first,
      layout::keep_scalars_t{.last_capacity = static_cast<cl_uint>(last_.capacity),
                             .all = search.changed.all ? cl_uint{1} : cl_uint{0},
                             .slots = search.now.slots,
                             .stamp = search.changed.stamp,
                             .capacity = static_cast<cl_uint>(now_.capacity)},
      keeps ? last_.buffer.get() : none, keeps ? removed() : none, same_filters ? none : search.now.filters,
      same_filters ? none : search.now.exclusions, keeps ? search.changed.stamps : none);
}

void PairDelta::set_keep_kernel(cl::Kernel& kernel, cl_uint first, const Search& search) const {
  opencl::set_arguments(kernel, set_keep(kernel, first, search, true), search.now.boxes, search.now.ungrown,
                        now_.buffer.get(), counts());
}

void PairDelta::keep(const Search& search) {
  if (most_to_keep() == 0) return;
  opencl::Profiler::Scope stage(profiler_, "keep");
  set_keep_kernel(keep_, 0, search);
  const std::size_t group = context_.launch().group;
  const std::size_t groups = opencl::divide_up(most_to_keep(), group * DELTA_RUN_OF(group));
  context_.queue().enqueueNDRangeKernel(keep_, cl::NullRange, cl::NDRange(groups * group), cl::NDRange(group),
                                        nullptr, stage.event());
}

cl_uint PairDelta::set_sink(cl::Kernel& kernel, cl_uint first, const Search& search) const {
  return set_pair_sink(kernel, first, search, now_.capacity, now_.buffer.get(), search.now.ungrown, counts());
}

PairDelta::Counts PairDelta::counts_of(const std::byte* counts) const {
  const auto* words = reinterpret_cast<const cl_uint*>(counts);
  const std::size_t added = words[layout::COUNT_ADDED] | std::uint64_t{words[layout::COUNT_ADDED_HIGH]} << 32;
  return {.found = last_.found() - words[layout::COUNT_REMOVED] + added,
          .added = added,
          .removed = words[layout::COUNT_REMOVED],
          .work = words[layout::COUNT_WORK],
          .is_unordered = words[layout::COUNT_UNORDERED] != 0,
          .invalid_boxes = words[layout::COUNT_INVALID],
          .first_invalid = ~words[layout::COUNT_INVALID_FIRST],
          .displacement = words[layout::COUNT_DISPLACEMENT],
          .grown_tiles = words[layout::COUNT_GROWN]};
}

void PairDelta::commit(const Counts& counts, cl_uint tag, bool is_next_ready) noexcept {
  now_.kept = counts.found - counts.added;
  now_.added = counts.added;
  work_ = counts.work;
  displacement_ = counts.displacement;
  last_tag_ = tag;
  ++frame_count_;
  is_clean_ = is_next_ready;
}

void PairDelta::commit_unread() noexcept {
  work_ = 0;
  ++frame_count_;
  ++unread_;
  is_clean_ = true;
  now_.kept = last_.found();  // as good a guess as any
  now_.added = 0;
}

PairDelta::Settled PairDelta::settled_of(std::uint64_t frames, cl_uint complete, cl_uint tag) noexcept {
  return {.frames = frames, .complete = frames - (static_cast<cl_uint>(frames) - complete), .tag = tag};
}

PairDelta::Settled PairDelta::settle() {
  std::array<cl_uint, layout::COUNTS> words{};
  context_.queue().enqueueReadBuffer(counts(), CL_TRUE, 0, count_bytes, words.data());
  const Settled settled =
      settled_of(unread_, words.at(layout::COUNT_COMPLETE), words.at(layout::COUNT_LAST_TAG));
  if ((settled.frames - settled.complete) % 2 != 0) frames_.swap();
  last_.kept = words.at(layout::COUNT_LAST_KEPT);
  last_.added = words.at(layout::COUNT_LAST_ADDED);
  last_tag_ = settled.tag;
  unread_ = 0;
  is_clean_ = false;
  return settled;
}

}  // namespace broadcl
