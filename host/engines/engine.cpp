#include "engines/engine.hpp"

#include <algorithm>
#include <utility>

#include "base/pair_lists.hpp"

namespace broadcl {

Engine::Engine(const opencl::Context& context, opencl::Profiler& profiler, MakePairFinder make_finder,
               Order::Target target)
    : context_(context),
      profiler_(profiler),
      make_finder_(make_finder),
      target_(target),
      delta_(context, profiler, frames_),
      order_(context, profiler, frames_, target),
      finder_(make_finder(context)) {}

std::unique_ptr<Engine> Engine::successor() const {
  auto next = std::make_unique<Engine>(context_, profiler_, make_finder_, target_);
  next->delta_.take(delta_);
  next->most_slots_ = most_slots_;
  return next;
}

void Engine::begin(Search search, cl_uint tag) {
  search_ = std::move(search);
  tag_ = tag;
  order_.begin(search_);
  finder_->begin(search_, delta_, profiler_);
}

void Engine::search() {
  finder_->build(search_, delta_, profiler_);
  enqueue();
}

void Engine::reserve_ahead(std::size_t slots, std::size_t pairs) {
  order_.reserve_ahead(slots, std::max(pairs, delta_.pair_count()));
  delta_.reserve_ahead(pairs);
}

void Engine::enqueue(Search search, cl_uint tag, const Report& report) {
  // Lists may have grown since reserve_ahead().
  if (!delta_.is_unsettled()) reserve_ahead(0, 0);
  search_ = std::move(search);
  search_.may_give_up = false;
  tag_ = tag;
  order_.begin(search_, report);
  finder_->begin(search_, delta_, profiler_);
  finder_->build(search_, delta_, profiler_);
  enqueue();
  context_.queue().flush();
  // Nothing below throws.
  delta_.commit_unread();
  frames_.swap();
}

PairDelta::Settled Engine::settle() {
  const PairDelta::Settled settled = delta_.settle();
  if (settled.complete < settled.frames) finder_->forget();
  return settled;
}

void Engine::enqueue() {
  most_slots_ = std::max<std::size_t>(most_slots_, search_.now.slots);
  if (!finder_->keeps(search_, delta_)) delta_.keep(search_);
  finder_->find(search_, delta_, profiler_);
  order_.enqueue(delta_, tag_);
}

/// Waits for the search, and repeats it if the lists were too small or the finder gave up.
PairDelta::Counts Engine::find() {
  PairDelta::Counts counts = order_.wait(delta_);
  const PairDelta::Counts first = counts;
  for (bool gave_up = finder_->gave_up(counts); gave_up || !delta_.fits(counts);
       gave_up = finder_->gave_up(counts)) {
    delta_.begin(counts.found);
    if (gave_up) finder_->rebuild(search_, delta_, profiler_);
    enqueue();
    counts = order_.wait(delta_);
  }
  counts.invalid_boxes = first.invalid_boxes;
  counts.first_invalid = first.first_invalid;
  return counts;
}

// NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
void Engine::commit(const Completed& completed) noexcept {
  delta_.commit(completed.counts, tag_, completed.is_next_ready);
  order_.commit(completed.counts);
  frames_.swap();
}

Engine::Completed Engine::complete() {
  const PairDelta::Counts counts = find();
  const bool is_next_ready = order_.complete(delta_, counts);
  profiler_.resolve();
  return {.counts = counts, .is_next_ready = is_next_ready};
}

std::vector<Pair> Engine::finish_only_search() {
  const PairDelta::Counts counts = find();
  profiler_.resolve();
  commit({.counts = counts, .is_next_ready = false});
  return pairs();
}

Touching Engine::touching(AxisSet axes) {
  if (frames_.last.objects.ungrown() != nullptr) return {.all = true, .pairs = pairs()};
  if (!touching_) touching_.emplace(context_, profiler_);
  Touching touching{.all = true, .pairs = touching_->find(frames_.last, axes)};
  profiler_.resolve();
  return touching;
}

cl::Buffer Engine::sorted_pairs() {
  const std::size_t n = pair_count();
  const std::size_t bytes = std::max<std::size_t>(1, n) * sizeof(Pair);
  cl::Buffer sorted = context_.buffer(bytes);
  if (n == 0) return sorted;
  delta_.copy_pairs(sorted);
  order_.sort(sorted, n, most_slots_, context_.buffer(bytes));
  order_.renumber(sorted, n, frames_.last.objects.second_set);
  return sorted;
}

std::vector<Pair> Engine::pairs() {
  std::vector<Pair> pairs;
  resize_for_writing(pairs, pair_count());
  if (pairs.empty()) return pairs;
  context_.queue().enqueueReadBuffer(sorted_pairs(), CL_TRUE, 0, pairs.size() * sizeof(Pair), pairs.data());
  return pairs;
}

}  // namespace broadcl
