// Random calls of a DeviceBroadPhase: core_random_test.cpp does the same with a BroadPhase.
#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/opencl.hpp>

#include "core_random_script.hpp"
#include "device_life.hpp"
#include "each_algorithm.hpp"
#include "random_scripts.hpp"
#include "reference.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

/// Plays a script to a DeviceBroadPhase and the reference. If the filters divide the objects into two sets,
/// the first objects are the first set.
class DevicePlayer {
 public:
  DevicePlayer(const CallersQueue& queue, const std::string& algorithm, const CoreScript& script)
      : queue_(queue), script_(script), broad_phase_(queue(), {.algorithm = algorithm}) {
    if (are_two_sets()) {
      boxes_.assign(1 + script.most / 3, inverted);
      filters_.resize(boxes_.size());
    }
    first_count_ = boxes_.size();
    reserve();
  }

  void apply(const CoreOp& op) {
    switch (op.verb) {
      case CoreVerb::add:
        for (unsigned k = 0; k < op.count && boxes_.size() < most(); ++k) add(op, k);
        break;
      case CoreVerb::map:
        layout_ = op.which % 3;
        if (op.count > 1) resize(op);
        break;
      case CoreVerb::exclude:
        exclude(exclusions_of(op, reference_.pairs()));
        break;
      case CoreVerb::begin:
        if (!begun_) begin();
        break;
      case CoreVerb::update:
        update();
        break;
      case CoreVerb::enqueue:
        enqueue(op.which % 3);
        break;
      case CoreVerb::shrink:
        shrink();
        break;
      case CoreVerb::refuse:
        refuse();
        break;
      case CoreVerb::change_side:
        break;
      default:
        for (unsigned k = 0; k < op.count && !boxes_.empty(); ++k) {
          apply_to((op.which + k) % boxes_.size(), op, k);
        }
    }
  }

  void update() {
    if (!begun_) begin();
    const auto result = broad_phase_.finish();
    const Reference::Changes expected = reference_.finish();
    require(same("added", queue_.read(result.added), numbered(expected.added)));
    require(same("removed", queue_.read(result.removed), numbered(expected.removed)));
    if (result.pair_count != reference_.pairs().size()) fail("another number of pairs");
    if (result.invalid_boxes != begun_->invalid || result.first_invalid != begun_->first_invalid) {
      fail(std::to_string(result.invalid_boxes) + " invalid boxes");
    }
    if (result.incomplete != std::exchange(incomplete_, 0)) fail("another number of incomplete updates");
    begun_.reset();
    require(same("pairs", queue_.read(broad_phase_.pairs()), numbered(reference_.pairs())));
  }

 private:
  struct Given {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer boxes, second, filters;
    DeviceBroadPhase::Boxes arguments;
    std::size_t invalid = 0;
    std::optional<std::uint32_t> first_invalid;
  };
  /// An update that nobody has waited for.
  struct Enqueued {  // NOLINT(bugprone-exception-escape): as above
    Given given;
    cl::Buffer added, removed, counts;
    std::array<std::uint32_t, 4> expected_counts;
    Reference::Changes expected;
  };

  [[nodiscard]] bool are_two_sets() const {
    return script_.filters == FilterKind::sets || script_.filters == FilterKind::sets_of_worlds;
  }
  [[nodiscard]] std::uint32_t most() const { return script_.most + script_.most / 3 + 1; }

  void reserve() { broad_phase_.reserve(most(), most() * most() / 2, true); }

  /// Pairs by the indices of boxes in their sets.
  [[nodiscard]] Pairs numbered(Pairs pairs) const {
    for (Pair& pair : pairs) pair.b -= static_cast<std::uint32_t>(first_count_);
    return pairs;
  }

  void add(const CoreOp& op, unsigned call) {
    boxes_.push_back(box_of(script_, op, call));
    filters_.push_back(filter_of(script_, op, call));
  }

  void resize(const CoreOp& op) {
    const std::size_t n = first_count_ + std::min(op.count, script_.most);
    if (boxes_.size() > n) {
      boxes_.resize(n);
      filters_.resize(n);
    }
    for (unsigned k = 0; boxes_.size() < n; ++k) add(op, k);
  }

  void apply_to(std::size_t k, const CoreOp& op, unsigned call) {
    if (op.verb == CoreVerb::filter) {
      filters_[k] = filter_of(script_, op, call);
    } else if (op.verb == CoreVerb::remove && op.which % 2 == 0 && boxes_.size() > first_count_) {
      boxes_.pop_back();
      filters_.pop_back();
    } else {
      boxes_[k] = op.verb == CoreVerb::remove ? inverted : box_of(script_, op, call);
    }
  }

  /// Boxes in memory of the device, with other floats before and between them, depending on the layout.
  [[nodiscard]] cl::Buffer give(std::size_t first, std::size_t end) const {
    std::vector<float> floats(layout_, nan_value);
    for (std::size_t k = first; k < end; ++k) {
      floats.insert(floats.end(), boxes_[k].lower.begin(), boxes_[k].lower.end());
      floats.insert(floats.end(), boxes_[k].upper.begin(), boxes_[k].upper.end());
      floats.insert(floats.end(), layout_, nan_value);
    }
    return queue_.buffer_of(floats);
  }

  /// Gives all objects to the reference and to the device.
  Given give() {
    const std::size_t n = boxes_.size();
    reference_.map(n);
    Given given;
    for (std::uint32_t k = 0; k < n; ++k) {
      Filter filter = filters_[k];
      if (are_two_sets()) {  // only body and world count
        const Filter& set = k < first_count_ ? Filter::first_set : Filter::second_set;
        filter = {.group = set.group, .mask = set.mask, .body = filter.body, .world = filter.world};
      }
      reference_.set_filter(k, filter);
      reference_.move(k, boxes_[k]);
      if (!has_nan(boxes_[k])) continue;
      ++given.invalid;
      if (!given.first_invalid) given.first_invalid = k;
    }
    const std::size_t first = are_two_sets() ? first_count_ : n;
    given.boxes = give(0, first);
    given.filters = queue_.buffer_of(filters_);
    const std::size_t offset = layout_ * sizeof(float);
    given.arguments = {.buffer = given.boxes(),
                       .count = first,
                       .offset = offset,
                       .stride = sizeof(Aabb) + offset,
                       .filters = script_.filters == FilterKind::none ? nullptr : given.filters(),
                       .worlds = script_.filters > FilterKind::groups};
    if (!are_two_sets()) return given;
    given.second = give(first, n);
    given.arguments.second = {
        .buffer = given.second(), .count = n - first, .offset = offset, .stride = sizeof(Aabb) + offset};
    return given;
  }

  void begin() {
    Given given = give();
    broad_phase_.begin(given.arguments);
    check_enqueued();
    reference_.begin();
    begun_ = std::move(given);
  }

  void exclude(const Pairs& pairs) {
    if (begun_) return require_error("finish()", [&] { broad_phase_.set_exclusions(pairs); });
    broad_phase_.set_exclusions(pairs);
    check_enqueued();
    reference_.set_exclusions(pairs);
  }

  void shrink() {
    if (begun_) return require_error("finish()", [&] { broad_phase_.shrink(); });
    broad_phase_.shrink();
    check_enqueued();
    reserve();
  }

  /// @param lists 0: they are one too short, so that this update and all later ones are incomplete. 1: they
  /// just suffice. Otherwise they are long.
  void enqueue(unsigned lists) {
    if (begun_) return;
    Given given = give();
    Reference next = reference_;
    const Reference::Changes expected = next.finish();
    const std::size_t longest = std::max(expected.added.size(), expected.removed.size());
    const std::size_t capacity = std::max<std::size_t>(1, lists == 0 && longest > 0 ? longest - 1
                                                          : lists == 1              ? longest
                                                                                    : longest + 1000);
    Enqueued update{.given = std::move(given),
                    .added = queue_.buffer_of(Pairs(capacity)),
                    .removed = queue_.buffer_of(Pairs(capacity)),
                    .counts = queue_.buffer_of(std::vector<std::uint32_t>(4, 77)),
                    .expected_counts = {},
                    .expected = expected};
    broad_phase_.enqueue(update.given.arguments, {.added = update.added(),
                                                  .removed = update.removed(),
                                                  .capacity = capacity,
                                                  .counts = update.counts()});
    is_halted_ = is_halted_ || longest > capacity;
    if (is_halted_) {
      ++incomplete_;
      update.expected = {};
    } else {
      reference_ = std::move(next);
    }
    update.expected_counts = {static_cast<std::uint32_t>(update.expected.added.size()),
                              static_cast<std::uint32_t>(update.expected.removed.size()),
                              static_cast<std::uint32_t>(reference_.pairs().size()), is_halted_ ? 1U : 0U};
    enqueued_.push_back(std::move(update));
  }

  /// After a call that waits.
  void check_enqueued() {
    for (const Enqueued& update : enqueued_) {
      const auto counts = queue_.read_counts(update.counts);
      if (counts != update.expected_counts) fail("the counts are " + ::testing::PrintToString(counts));
      const Pairs added = queue_.read({.buffer = update.added(), .count = counts[0]});
      const Pairs removed = queue_.read({.buffer = update.removed(), .count = counts[1]});
      require(same("added by enqueue()", added, numbered(update.expected.added)));
      require(same("removed by enqueue()", removed, numbered(update.expected.removed)));
    }
    enqueued_.clear();
    is_halted_ = false;
  }

  void refuse() {
    const Pairs of_itself{{0, 1}, {3, 3}};
    require_error(begun_ ? "finish()" : "and itself", [&] { broad_phase_.set_exclusions(of_itself); });
    if (begun_) {
      require_error("finish()", [&] { (void)broad_phase_.pairs(); });
      require_error("finish()", [&] { broad_phase_.reserve(1, 1); });
      require_error("finish()", [&] { broad_phase_.begin(begun_->arguments); });
    } else {
      require_error("without begin()", [&] { (void)broad_phase_.finish(); });
      require_error("is null", [&] { broad_phase_.begin({.buffer = nullptr, .count = 3}); });
    }
  }

  const CallersQueue& queue_;
  const CoreScript& script_;
  DeviceBroadPhase broad_phase_;
  Reference reference_;
  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
  std::size_t first_count_ = 0;  // of two sets; otherwise 0
  std::size_t layout_ = 0;       // floats before and behind each box
  std::optional<Given> begun_;
  std::vector<Enqueued> enqueued_;
  bool is_halted_ = false;  // an enqueued update is incomplete
  std::size_t incomplete_ = 0;
};

class RandomDevice : public ::testing::TestWithParam<std::string> {
 protected:
  void play(ScriptSize size, std::size_t scripts, std::optional<std::uint64_t> seed) const {
    check_scripts(GetParam(), scripts, seed, [&] {
      const CoreScript script = *core_scripts(size);
      DevicePlayer player(queue_, GetParam(), script);
      apply_each(script.ops, [&](const CoreOp& op) { player.apply(op); });
      player.update();
    });
  }

  CallersQueue queue_;
};

SUITE_ALSO_IN(RandomDevice, gpu_profile | rusticl);

TEST_P(RandomDevice, SomeRandomCalls) {
  play(ScriptSize::small, is_slow_device() ? 3 : 10, seed_of_ci);
}

ALSO_IN(oclgrind);
TEST_P(RandomDevice, SmallRandomCalls) {
  play(ScriptSize::tiny, 3, seed_of_ci);
}

INSTANTIATE_TEST_SUITE_P(All, RandomDevice, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

using LongRandomDevice = RandomDevice;

TEST_P(LongRandomDevice, ManyRandomCalls) {
  play(ScriptSize::small, 2000, std::nullopt);
}

INSTANTIATE_TEST_SUITE_P(Long, LongRandomDevice, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

}  // namespace
}  // namespace broadcl::test
