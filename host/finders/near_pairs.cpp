#include "finders/near_pairs.hpp"

#include <algorithm>
#include <bit>
#include <exception>
#include <limits>
#include <string_view>
#include <vector>

#include <broadcl/aabb.hpp>

#include "engines/kernel_arguments.hpp"

namespace broadcl {
namespace {

constexpr std::size_t test_groups_per_unit = 8;  // enough to keep a compute unit busy

/// The margin, as a multiple of the distance that boxes moved in the last frame.
constexpr float margin_factor = 1.125F;
constexpr std::size_t least_near_pairs = 1 << 16;
constexpr std::size_t most_near_pairs = std::size_t{1} << 31;  // indices are 32-bit numbers
/// More near pairs would take longer to test than an early search saves. Boxes and pairs of the last frame.
std::size_t most_useful(std::size_t boxes, std::size_t pairs) {
  return std::min(most_near_pairs, std::max({least_near_pairs, boxes, 4 * pairs}));
}
constexpr std::size_t never = std::numeric_limits<std::size_t>::max();

}  // namespace

/// @returns Whether the context can provide what this needs.
bool NearPairs::load() try {
  if (queue_() != nullptr) return true;
  grow_ = context_.sized_kernel(program_, "near_pairs_grow");
  test_ = context_.sized_kernel(program_, "near_pairs_test", layout::NEAR_GROUP);
  counts_ = context_.buffer(PairDelta::count_bytes);
  queue_ = context_.second_queue();
  return true;
} catch (const std::exception&) {  // cl::Error, Error
  fewest_ = never;
  return false;
}

bool NearPairs::is_possible(const Search& search) const noexcept {
  return search.source == nullptr && search.may_give_up && search.changed.all && search.same_filters &&
         search.changed.recycled == 0 && search.now.slots == search.last.slots && search.now.slots >= fewest_;
}

/// Whether the distances that boxes moved in the last frame are known; draws conclusions from that frame.
bool NearPairs::is_distance_known(const Search& search, const PairDelta& sink, bool pays) {
  // (If the last frame here failed, another finder may have done the one after it.)
  const bool has_failed =
      plan_.state == State::searching || (plan_.state != State::off && sink.frames() == plan_.frame);
  if (plan_.state == State::searching) wait();
  if (has_failed) pause();  // perhaps memory was short
  // (If the last boxes are in another buffer now, the commands that copied them may not have ended.)
  const bool follows = sink.frames() == plan_.frame + 1 && search.last.boxes() == plan_.boxes;
  if (!follows || plan_.state == State::off) return false;
  if (plan_.state == State::measured) return true;
  if (pays) {
    back_off_.shorten();
  } else {
    pause();
  }
  return pays;
}

bool NearPairs::begin(const Search& search, const PairDelta& sink, bool can_search, bool pays,
                      opencl::Profiler& profiler) {
  const bool is_margin_known = is_distance_known(search, sink, pays);
  plan_ = {.frame = sink.frames(), .boxes = search.now.boxes()};
  if (!is_possible(search)) margin_limit_ = std::numeric_limits<float>::infinity();
  if (!is_possible(search) || !back_off_.is_over(plan_.frame) || !load()) return false;
  plan_.state = State::measured;
  if (!can_search || !is_margin_known) return false;
  plan_.margin = margin_factor * std::bit_cast<float>(sink.displacement());
  if (!(plan_.margin < margin_limit_) || !reserve(search.now.slots, sink.pair_count(), profiler)) {
    pause();
    return false;
  }

  context_.queue().flush();  // so that the upload starts first
  plan_.state = State::searching;
  opencl::Profiler::Scope stage(profiler, "early");
  opencl::set_arguments(grow_.kernel, 0, search.last.slots, search.last.boxes, plan_.margin, grown_.get(),
                        counts_);
  grow_.enqueue(queue_, std::max<std::size_t>(search.last.slots, layout::COUNTS), stage.event());
  return true;
}

/// @returns Whether there is enough memory.
bool NearPairs::reserve(std::size_t slots, std::size_t pairs, opencl::Profiler& profiler) try {
  const auto reserve = [&](opencl::GrowingBuffer& buffer, std::size_t bytes, std::string_view what) {
    if (bytes <= buffer.bytes()) return;
    buffer.reserve(context_, bytes, what);
    // Some drivers find out only then that memory is short. (In the queue whose commands use this memory.)
    opencl::Profiler::Scope stage(profiler, "clear");
    context_.fill(queue_, buffer.get(), 0, 0, 1, stage.event());
  };
  reserve(grown_, slots * sizeof(Aabb), "boxes");
  const std::size_t wanted =
      std::min(std::max({wanted_, pairs, least_near_pairs}), most_useful(slots, pairs));
  reserve(pairs_, wanted * sizeof(Pair), "near pairs");
  return true;
} catch (const std::exception&) {  // cl::Error, Error
  return false;
}

cl_uint NearPairs::capacity() const noexcept {
  return static_cast<cl_uint>(std::min(most_near_pairs, pairs_.bytes() / sizeof(Pair)));
}

void NearPairs::set_sink(cl::Kernel& kernel, cl_uint first, const Search& search) const {
  // (Filters did not change, and no object was replaced. Distances are tested when the boxes are there.)
  set_pair_sink(kernel, first, search, capacity(), pairs_.get(), {}, counts_);
}

void NearPairs::searched() {
  queue_.enqueueMarkerWithWaitList(nullptr, &searched_);
  queue_.flush();
}

void NearPairs::await_search() {
  const std::vector<cl::Event> events{searched_};
  context_.queue().enqueueBarrierWithWaitList(&events);
}

void NearPairs::test(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
  if (plan_.state == State::off) return;
  opencl::Profiler::Scope stage(profiler, "near");
  const cl_uint next = opencl::set_arguments(
      test_.kernel, 0, search.now.slots, search.now.boxes, is_early() ? plan_.margin : 0.0F, capacity(),
      is_early() ? pairs_.get() : cl::Buffer(), is_early() ? counts_ : cl::Buffer());
  sink.set_sink(test_.kernel, next, search);
  const std::size_t items = context_.device().compute_units * test_groups_per_unit * test_.group;
  test_.enqueue(context_.queue(), std::min<std::size_t>(search.now.slots, items), stage.event());
}

bool NearPairs::is_early() const noexcept {
  return plan_.state == State::searching || plan_.state == State::searched;
}

bool NearPairs::missed(const PairDelta::Counts& counts, bool finder_gave_up) noexcept {
  if (!is_early()) return false;
  plan_.state = State::searched;
  if (finder_gave_up) margin_limit_ = plan_.margin / 2;
  if (counts.displacement == TOO_MANY_NEAR && !finder_gave_up) wanted_ = 4 * std::size_t{capacity()};
  return finder_gave_up || counts.displacement > std::bit_cast<cl_uint>(plan_.margin);
}

void NearPairs::pause() {
  plan_.state = State::off;
  grown_.clear();
  pairs_.clear();
  back_off_.start(plan_.frame);
}

void NearPairs::wait() const noexcept {
  if (queue_() != nullptr) opencl::wait_if_possible(queue_);
}

}  // namespace broadcl
