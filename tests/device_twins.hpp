#pragma once

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/opencl.hpp>

#include "boxes.hpp"
#include "callers_queue.hpp"
#include "reference.hpp"
#include "twins.hpp"

namespace broadcl::test {

/// All objects of an update.
struct DeviceFrame {
  std::vector<Aabb> boxes{};
  std::vector<Filter> filters{};  ///< Of each box, or none. Of two sets, group and mask do not count.
  std::optional<std::size_t> first_count{};  ///< If there are two sets, how many boxes are in the first one.
  bool worlds = false;
  std::size_t ordered_worlds = 0;
  std::size_t gap = 0;  ///< Floats of the caller before and behind each box.
};

/// A DeviceBroadPhase and the reference, which get the same objects.
/// @tparam Trouble As for Twins.
template <class Trouble = NoTrouble>
class DeviceTwins {
 public:
  /// @param looks As for Twins.
  DeviceTwins(const CallersQueue& queue, const DeviceBroadPhase::Config& config, const Trouble& trouble = {},
              bool looks = false)
      : queue_(queue), broad_phase_(queue(), config), trouble_(trouble), looks_(looks) {}

  void begin(const DeviceFrame& frame) {
    now_ = give(frame);
    broad_phase_.begin(now_.arguments);
    settle();
    reference_.begin();
  }
  /// Each result is whether everything was right since the last one.
  [[nodiscard]] ::testing::AssertionResult finish() { return agree(broad_phase_.finish()); }
  [[nodiscard]] ::testing::AssertionResult update(const DeviceFrame& frame) {
    const Pairs known = pairs();
    now_ = give(frame);
    const auto result = trouble_.call(
        [&] {
          broad_phase_.begin(now_.arguments);
          return broad_phase_.finish();
        },
        [&] { look(known); });
    settle();
    return agree(result);
  }

  void set_exclusions(std::span<const Pair> pairs) {
    broad_phase_.set_exclusions(pairs);
    settle();
    reference_.set_exclusions(pairs);
  }
  void reserve(std::size_t objects, std::size_t pairs) {
    const Pairs known = this->pairs();
    trouble_.call([&] { broad_phase_.reserve(objects, pairs, true); }, [&] { look(known); });
  }
  void shrink() {
    const Pairs known = pairs();
    trouble_.call([&] { broad_phase_.shrink(); }, [&] { look(known); });
    settle();
  }

  /// How many pairs an update would add or remove, whichever is more.
  [[nodiscard]] std::size_t changes_of(const DeviceFrame& frame) const {
    Reference next = reference_;
    give(frame, next);
    const Reference::Changes changes = next.finish();
    return std::max(changes.added.size(), changes.removed.size());
  }
  /// An update that nobody waits for. If more pairs change than the capacity of its lists, it is incomplete,
  /// as are all others until a call waits.
  void enqueue(const DeviceFrame& frame, std::size_t capacity) {
    const Pairs known = pairs();
    Reference before = reference_;
    Enqueued update;
    update.given = give(frame);
    update.added = queue_.buffer_of(Pairs(capacity));
    update.removed = queue_.buffer_of(Pairs(capacity));
    update.counts = queue_.buffer_of(std::vector<std::uint32_t>(4, 77));
    DeviceBroadPhase::ChangeBuffers changes{.added = update.added(),
                                            .removed = update.removed(),
                                            .capacity = capacity,
                                            .counts = update.counts()};
    if (frame.ordered_worlds > 0) {
      const std::vector<std::uint32_t> offsets(frame.ordered_worlds + 2);
      changes.added_offsets = (update.added_offsets = queue_.buffer_of(offsets))();
      changes.removed_offsets = (update.removed_offsets = queue_.buffer_of(offsets))();
    }
    trouble_.call([&] { broad_phase_.enqueue(update.given.arguments, changes); }, [&] { look(known); });
    Reference next = reference_;
    Reference::Changes expected = next.finish();
    is_halted_ = is_halted_ || std::max(expected.added.size(), expected.removed.size()) > capacity;
    update.last_filters = last_filters_;
    if (is_halted_) {
      ++incomplete_;
      reference_ = std::move(before);
    } else {
      reference_ = std::move(next);
      last_filters_ = update.given.filters;
      update.expected = std::move(expected);
    }
    update.expected_counts = {static_cast<std::uint32_t>(update.expected.added.size()),
                              static_cast<std::uint32_t>(update.expected.removed.size()),
                              static_cast<std::uint32_t>(reference_.pairs().size()), is_halted_ ? 1U : 0U};
    enqueued_.push_back(std::move(update));
  }
  /// Compares what enqueued updates have written. (That does not count as a call that waits.)
  [[nodiscard]] ::testing::AssertionResult agree() {
    for (const Enqueued& update : enqueued_) {
      const auto counts = queue_.read_counts(update.counts);
      if (counts != update.expected_counts) note("the counts are " + ::testing::PrintToString(counts));
      if (!wrong_.empty()) break;
      expect_list("added by enqueue()", {update.added(), counts[0], update.added_offsets()},
                  update.expected.added, update.given, update.given.filters);
      expect_list("removed by enqueue()", {update.removed(), counts[1], update.removed_offsets()},
                  update.expected.removed, update.given, update.last_filters);
    }
    enqueued_.clear();
    if (wrong_.empty()) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure() << std::exchange(wrong_, "");
  }

  /// Compares all pairs, which waits.
  [[nodiscard]] ::testing::AssertionResult agree_on_pairs() {
    expect(same("pairs", queue_.read(broad_phase_.pairs()), pairs()));
    settle();
    return agree();
  }

  /// As of the last complete update; of two sets, `b` is an index into the second one.
  [[nodiscard]] Pairs pairs() const { return numbered(reference_.pairs()); }
  [[nodiscard]] const Reference& reference() const noexcept { return reference_; }
  /// Whether the last enqueued update is incomplete.
  [[nodiscard]] bool is_halted() const noexcept { return is_halted_; }
  [[nodiscard]] bool is_in_flight() const noexcept { return reference_.is_in_flight(); }
  [[nodiscard]] const Trouble& trouble() const noexcept { return trouble_; }
  void set_trouble(const Trouble& trouble) { trouble_ = trouble; }
  [[nodiscard]] DeviceBroadPhase& tested() noexcept { return broad_phase_; }
  /// What begin() was last called with.
  [[nodiscard]] const DeviceBroadPhase::Boxes& arguments() const noexcept { return now_.arguments; }

 private:
  struct Given {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer boxes, second, filter_buffer;
    DeviceBroadPhase::Boxes arguments;
    std::vector<Filter> filters;
    std::size_t invalid = 0;
    std::optional<std::uint32_t> first_invalid;
  };
  struct Enqueued {  // NOLINT(bugprone-exception-escape): as above
    Given given;
    cl::Buffer added, removed, counts, added_offsets, removed_offsets;
    std::vector<Filter> last_filters;
    std::array<std::uint32_t, 4> expected_counts{};
    Reference::Changes expected;
  };

  static void give(const DeviceFrame& frame, Reference& reference) {
    reference.map(frame.boxes.size());
    for (std::uint32_t k = 0; k < frame.boxes.size(); ++k) {
      Filter filter = frame.filters.empty() ? Filter() : frame.filters[k];
      if (frame.first_count) {
        const Filter& set = k < *frame.first_count ? Filter::first_set : Filter::second_set;
        filter = {.group = set.group, .mask = set.mask, .body = filter.body, .world = filter.world};
      }
      reference.set_filter(k, filter);
      reference.move(k, frame.boxes[k]);
    }
  }

  /// Gives all objects to the reference, and the boxes and filters to the device.
  Given give(const DeviceFrame& frame) {
    give(frame, reference_);
    const std::size_t n = frame.boxes.size();
    const std::size_t first_count = frame.first_count.value_or(n);
    first_count_ = frame.first_count.value_or(0);
    Given given;
    given.filters = frame.filters;
    given.filters.resize(n);
    for (std::uint32_t k = 0; k < n; ++k) {
      if (!has_nan(frame.boxes[k])) continue;
      ++given.invalid;
      if (!given.first_invalid) given.first_invalid = k;
    }
    const std::span<const Aabb> boxes(frame.boxes);
    given.boxes = buffer_of(boxes.first(first_count), frame.gap);
    if (!frame.filters.empty()) given.filter_buffer = queue_.buffer_of(given.filters);
    const std::size_t offset = frame.gap * sizeof(float);
    given.arguments = {.buffer = given.boxes(),
                       .count = first_count,
                       .offset = offset,
                       .stride = sizeof(Aabb) + offset,
                       .filters = given.filter_buffer(),
                       .worlds = frame.worlds,
                       .ordered_worlds = frame.ordered_worlds};
    if (!frame.first_count) return given;
    given.second = buffer_of(boxes.subspan(first_count), frame.gap);
    given.arguments.second = {.buffer = given.second(),
                              .count = n - first_count,
                              .offset = offset,
                              .stride = sizeof(Aabb) + offset};
    return given;
  }

  /// Boxes with other floats before and between them.
  [[nodiscard]] cl::Buffer buffer_of(std::span<const Aabb> boxes, std::size_t gap) const {
    std::vector<float> floats(gap, nan_value);
    for (const Aabb& box : boxes) {
      floats.insert(floats.end(), box.lower.begin(), box.lower.end());
      floats.insert(floats.end(), box.upper.begin(), box.upper.end());
      floats.insert(floats.end(), gap, nan_value);
    }
    return queue_.buffer_of(floats);
  }

  [[nodiscard]] ::testing::AssertionResult agree(const DeviceBroadPhase::Result& result) {
    const Reference::Changes expected = reference_.finish();
    expect_list("added", result.added, expected.added, now_, now_.filters);
    expect_list("removed", result.removed, expected.removed, now_, last_filters_);
    last_filters_ = now_.filters;
    if (result.pair_count != reference_.pairs().size()) note("another number of pairs");
    if (result.invalid_boxes != now_.invalid || result.first_invalid != now_.first_invalid)
      note(std::to_string(result.invalid_boxes) + " invalid boxes");
    if (result.incomplete != std::exchange(incomplete_, 0)) note("another number of incomplete updates");
    if (wrong_.empty()) {
      const auto all = trouble_.call([&] { return broad_phase_.pairs(); }, [] {});
      expect(same("pairs", queue_.read(all), pairs()));
    }
    return agree();
  }

  /// A call has waited: the next update is complete if it fits.
  void settle() { is_halted_ = false; }

  void look(const Pairs& known) {
    if (looks_) expect(same("known", queue_.read(broad_phase_.pairs()), known));
  }

  [[nodiscard]] Pairs numbered(Pairs pairs) const {
    for (Pair& pair : pairs) pair.b -= static_cast<std::uint32_t>(first_count_);
    return pairs;
  }

  /// @param filters Of the objects of the pairs.
  void expect_list(const char* what, const DeviceBroadPhase::PairBuffer& list, Pairs pairs,
                   const Given& given, const std::vector<Filter>& filters) {
    const auto worlds = static_cast<std::uint32_t>(given.arguments.ordered_worlds);
    if (worlds == 0) return expect(same(what, queue_.read(list), numbered(std::move(pairs))));
    const auto world_of = [&](const Pair& pair) {
      const std::uint32_t world = filters[pair.b].world;
      return std::min(worlds, world != Filter::all_worlds ? world : filters[pair.a].world);
    };
    std::ranges::stable_sort(pairs, {}, world_of);
    expect(same(what, queue_.read(list), numbered(pairs)));
    for (std::uint32_t world = 0; world < worlds + 2; ++world) {
      const auto begin = std::ranges::lower_bound(pairs, world, {}, world_of);
      if (queue_.read<std::uint32_t>(list.offsets, worlds + 2).at(world) !=
          static_cast<std::uint32_t>(begin - pairs.begin()))
        note(std::string(what) + ": another offset of world " + std::to_string(world));
    }
  }

  /// Remembers the first thing that is wrong.
  void note(const std::string& what) {
    if (wrong_.empty()) wrong_ = what;
  }
  void expect(const ::testing::AssertionResult& result) {
    if (!result) note(result.message());
  }

  const CallersQueue& queue_;
  DeviceBroadPhase broad_phase_;
  Reference reference_;
  Trouble trouble_;
  bool looks_;
  Given now_;
  std::size_t first_count_ = 0;       // of two sets; otherwise 0
  std::vector<Filter> last_filters_;  // of the last complete update
  std::vector<Enqueued> enqueued_;
  bool is_halted_ = false;
  std::size_t incomplete_ = 0;
  std::string wrong_;
};

}  // namespace broadcl::test
