// Going back to a saved moment: the random scripts of core_random_test.cpp do so, too.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "base/packed_box.hpp"
#include "boxes.hpp"
#include "each_algorithm.hpp"
#include "expect_error.hpp"
#include "scenes/generators.hpp"

namespace broadcl::test {
namespace {

using scenes::MovingBoxes;
using ::testing::HasSubstr;

/// Objects of all kinds, some ids of which are free.
template <class Box>
void populate(BasicBroadPhase<Box>& broad_phase, std::span<const Aabb> boxes) {
  for (std::uint32_t k = 0; k < boxes.size(); ++k)
    (void)broad_phase.add(BoxView(boxes.subspan(k, 1)), Filter{.body = k / 2, .world = k % 3});
  const std::vector<std::uint32_t> ids{1, 4, 6};
  const std::vector<BoundType<Box>> reaches{0.5};
  broad_phase.set_reach(ids, reaches);
  for (std::uint32_t id = 10; id < boxes.size(); id += 40) broad_phase.remove(id);
}

/// What happens after a moment is the same each time; the lists are all that is reported.
template <class Box>
Pairs go_on(BasicBroadPhase<Box>& broad_phase, MovingBoxes motion, std::uint32_t frames) {
  Pairs reported;
  for (std::uint32_t frame = 0; frame < frames; ++frame) {
    motion.advance();
    for (std::uint32_t id = frame; id < motion.boxes().size(); id += 3) {
      if (!broad_phase.contains(id)) continue;
      broad_phase.move(std::vector{id}, BoxView(std::span(motion.boxes()).subspan(id, 1)));
    }
    (void)broad_phase.add(BoxView(std::span(motion.boxes()).first(frame)), Filter{.world = 2});
    if (frame % 2 == 1) broad_phase.remove(frame);
    const Delta delta = broad_phase.update();
    reported.insert(reported.end(), delta.added.begin(), delta.added.end());
    reported.insert(reported.end(), delta.removed.begin(), delta.removed.end());
  }
  return reported;
}

/// A state goes from one object to others of any algorithm, which then do what the first one did.
template <class Box>
void expect_the_same_future(const BroadPhase::Config& config) {
  const MovingBoxes motion(700, MovingBoxes::Sizes::mixed);
  BasicBroadPhase<Box> first({.algorithm = "oracle"});
  populate<Box>(first, motion.boxes());
  const Pairs excluded{{0, 3}, {2, 9}, {5, 700}};
  first.set_exclusions(excluded);
  (void)first.update();
  const BasicState<Box> state = first.save();
  const Pairs pairs = first.pairs();
  ASSERT_GT(pairs.size(), 100U);
  const Pairs future = go_on<Box>(first, motion, 5);

  BasicBroadPhase<Box> other(config);
  for (int k = 0; k < 3; ++k) {
    const Delta delta = other.restore(state);
    if (k == 0) {
      EXPECT_TRUE(same(delta, pairs, Pairs()));
    }
    ASSERT_TRUE(same("pairs", other.pairs(), pairs));
    EXPECT_EQ(other.size(), motion.boxes().size() - 18);
    EXPECT_FALSE(other.contains(10));
    EXPECT_EQ(other.reach(4), 0.5);
    EXPECT_EQ(other.filter(8), (Filter{.body = 4, .world = 2}));
    ASSERT_TRUE(same("future", go_on<Box>(other, motion, 5), future));
    if (k == 1) other.shrink();
  }
}

TEST_P(EachAlgorithm, AStateFitsAnotherObject) {
  expect_the_same_future<Aabb>(config());
  expect_the_same_future<Aabb64>(config());
}

/// Objects that all move are received by a device before it is known what they are.
TEST_P(EachAlgorithm, ManyMovingObjectsGoBack) {
  const bool few = is_slow() || config().algorithm == "gpu-bf";
  MovingBoxes motion(few ? 1'000 : 20'000, MovingBoxes::Sizes::mixed);
  BroadPhase64 broad_phase(config());
  std::vector<State64> states;
  std::vector<Pairs> pairs;
  for (int k = 0; k < 4; ++k) {
    (void)broad_phase.update(BoxView(motion.boxes()));
    states.push_back(broad_phase.save());
    pairs.push_back(broad_phase.pairs());
    motion.advance();
  }
  for (const std::size_t k : {2U, 0U, 3U, 1U}) {
    const Pairs before = broad_phase.pairs();
    const Delta delta = broad_phase.restore(states[k]);
    ASSERT_TRUE(same("pairs", broad_phase.pairs(), pairs[k]));
    Pairs added;
    std::ranges::set_difference(pairs[k], before, std::back_inserter(added));
    EXPECT_TRUE(same("added", delta.added, added));
  }
}

/// Queries put what changed into the tree of the updates.
TEST_P(EachAlgorithm, QueriesBeforeAndAfterAreRight) {
  BroadPhase broad_phase(config());
  std::vector<Aabb> boxes;
  for (std::uint32_t k = 0; k < 300; ++k) boxes.push_back(apart(k));
  (void)broad_phase.add(BoxView(boxes));
  (void)broad_phase.update();
  const State state = broad_phase.save();
  for (std::uint32_t k = 0; k < 20; ++k) {
    broad_phase.remove(k);
    broad_phase.add(apart(k + 1));
    broad_phase.move(100 + k, apart(k));
    EXPECT_EQ(broad_phase.overlapping(BoxView(boxes)).size(), boxes.size());
    EXPECT_TRUE(same(broad_phase.restore(state), Pairs(), Pairs()));
    std::vector<std::uint32_t> ids;
    for (std::uint32_t id = 0; id < boxes.size(); id += 7) {
      ASSERT_EQ(broad_phase.overlapping(boxes[id], ids), 1U);
      EXPECT_EQ(ids.front(), id);
    }
  }
}

/// What changed since a moment is known, however many were saved afterwards, and whatever the changes were.
TEST(State, AllBoxesThatChangedSinceGoBack) {
  constexpr std::uint32_t objects = 100;
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  std::vector<Aabb> boxes;
  for (std::uint32_t k = 0; k < objects; ++k) boxes.push_back(apart(k));
  (void)broad_phase.update(BoxView(boxes));
  std::vector<State> states;
  std::vector<std::vector<Aabb>> saved;
  const auto go_back = [&](std::size_t to) {
    (void)broad_phase.restore(states[to]);
    boxes = saved[to];
    EXPECT_EQ(broad_phase.boxes(), boxes) << to;
  };
  const auto move = [&](std::uint32_t id) {
    boxes[id] = apart(1000 + states.size() + id);
    broad_phase.move(id, boxes[id]);
  };
  const auto save = [&] {
    (void)broad_phase.update(BoxView(boxes));
    states.push_back(broad_phase.save());
    saved.push_back(boxes);
  };
  for (std::uint32_t k = 0; k < 40; ++k) {
    move(k);
    save();
  }
  for (const std::size_t k : {39U, 0U, 25U, 24U, 38U, 1U}) go_back(k);
  for (std::uint32_t k = 0; k < 20; ++k) {
    if (k % 10 < 5) move(k);
    for (std::uint32_t id = 0; k % 10 == 5 && id < objects; ++id) move(id);
    if (k % 10 == 6) std::rotate(boxes.begin(), boxes.begin() + 1, boxes.end());
    save();
    move(k + 1);
    if (k % 2 == 0) {
      EXPECT_EQ(broad_phase.overlapping(BoxView(boxes)).size(), objects);
    }
    move(k + 2);
    go_back(k * 7 % (k + 1));
  }
  const std::uint32_t above = broad_phase.add(apart(2000));
  (void)broad_phase.update();
  broad_phase.remove(above);
  (void)broad_phase.update();
  go_back(states.size() - 1);
  broad_phase.move(1, empty_aabb());
  go_back(states.size() - 2);
}

TEST(State, WhatCannotBeSavedOrRestoredIsAnErrorThatSaysWhy) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  const State empty = broad_phase.save();
  broad_phase.add(unit);
  EXPECT_THAT(error_of([&] { (void)broad_phase.save(); }),
              HasSubstr("save() was called with changes that no update has reported; call update() first"));
  broad_phase.begin();
  EXPECT_THAT(error_of([&] { (void)broad_phase.save(); }),
              HasSubstr("save() was called between begin() and finish(); call finish() first"));
  EXPECT_THAT(error_of([&] { (void)broad_phase.restore(empty); }),
              HasSubstr("boxes cannot be replaced between begin() and finish(); call finish() first"));
  (void)broad_phase.finish();
  const State one = broad_phase.save();
  broad_phase.add(unit);
  BroadPhase near({.algorithm = "sweep-and-prune", .distance = 1});
  EXPECT_THAT(error_of([&] { (void)near.restore(one); }), HasSubstr("another Config::distance"));
  EXPECT_EQ(near.size(), 0U);
  EXPECT_TRUE(same(broad_phase.update(), Pairs{{0, 1}}, Pairs()))
      << "what refused to do something changed it";
  EXPECT_TRUE(same(broad_phase.restore(empty), Pairs(), Pairs{{0, 1}}));
  EXPECT_EQ(broad_phase.size(), 0U);
}

TEST(State, KeepsTheDistance) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune", .distance = 1.5});
  broad_phase.add(apart(0));
  broad_phase.add(apart(1));
  (void)broad_phase.update();
  const State state = broad_phase.save();
  broad_phase.remove(1);
  (void)broad_phase.update();
  BroadPhase other({.algorithm = "oracle", .distance = 1.5});
  EXPECT_TRUE(same(broad_phase.restore(state), other.restore(state).added, Pairs()));
  EXPECT_EQ(other.reach(1), 0.75F);
}

/// A small state of everything that a state has.
template <class Box>
BasicState<Box> small_state() {
  BasicBroadPhase<Box> broad_phase({.algorithm = "oracle"});
  std::vector<Aabb> boxes;
  for (std::size_t k = 0; k < 12; ++k) boxes.push_back(apart(k / 3));
  boxes[5] = inverted;
  populate<Box>(broad_phase, boxes);
  broad_phase.remove(3);
  broad_phase.set_exclusions(Pairs{{2, 9}, {0, 1}, {1, 2}});
  (void)broad_phase.update();
  return broad_phase.save();
}

/// Numbers of a state's bytes, and where they are: core/state.cpp.
template <class Box>
struct Bytes {
  using Bound = BoundType<Box>;
  static constexpr std::size_t boxes = 24 + sizeof(Bound);  // from here on, each list follows its size

  template <class Number>
  void set(std::size_t at, Number number) {
    std::memcpy(&bytes.at(at), &number, sizeof number);
  }
  [[nodiscard]] std::uint64_t word(std::size_t at) const {
    std::uint64_t word = 0;
    std::memcpy(&word, &bytes.at(at), sizeof word);
    return word;
  }
  [[nodiscard]] std::size_t slots() const { return word(boxes - 8); }
  [[nodiscard]] std::size_t reaches() const { return boxes + slots() * sizeof(Box) + 8; }
  [[nodiscard]] std::size_t filters() const { return reaches() + word(reaches() - 8) * sizeof(Bound) + 8; }
  [[nodiscard]] std::size_t exclusions() const {
    return filters() + word(filters() - 8) * sizeof(Filter) + 8;
  }
  [[nodiscard]] std::size_t live() const { return exclusions() + word(exclusions() - 8) * sizeof(Pair) + 8; }
  [[nodiscard]] std::string error() const {
    return error_of([&] { (void)BasicState<Box>::from_bytes(bytes); });
  }

  std::vector<std::byte> bytes = small_state<Box>().bytes();
};

template <class Box>
void expect_bytes_that_no_state_has_are_refused() {
  using Bound = BoundType<Box>;
  const Bytes<Box> good;
  (void)BasicState<Box>::from_bytes(good.bytes);
  ASSERT_EQ(good.live() + good.slots(), good.bytes.size());
  const auto expect = [&](std::size_t at, auto number, const std::string& why = "are damaged") {
    Bytes<Box> bad;
    bad.set(at, number);
    EXPECT_THAT(bad.error(), HasSubstr(why)) << "at " << at;
  };
  constexpr auto nan = std::numeric_limits<Bound>::quiet_NaN();
  const std::string other = "not those of a state in float" + std::to_string(8 * sizeof(Bound));
  expect(0, std::uint32_t{1}, other);                       // a version
  expect(4, std::uint32_t{1}, other);                       // no state
  expect(8, std::uint64_t{12 - sizeof(Bound)} * 8, other);  // the other type
  expect(16, Bound(0.5));                                   // a distance as well as reaches
  for (const std::size_t list :
       {std::size_t{good.boxes}, good.reaches(), good.filters(), good.exclusions(), good.live()}) {
    const std::uint64_t size = good.word(list - 8);
    for (const std::uint64_t number : {std::uint64_t{0}, size - 1, size + 1, ~std::uint64_t{0},
                                       std::uint64_t{1} << 60U, size + (std::uint64_t{1} << 61U)})
      expect(list - 8, number, "");
  }
  expect(good.boxes + 4 * sizeof(Box), nan);
  expect(good.boxes + 3 * sizeof(Box), Box{{0, 0, 0}, {1, 1, 1}});  // that no object has
  expect(good.reaches(), nan, "a reach of");
  expect(good.reaches(), Bound(-1), "a reach of");
  expect(good.reaches(), std::numeric_limits<Bound>::infinity(), "a reach of");
  expect(good.exclusions(), Pair{4, 4}, "and itself");
  expect(good.exclusions(), Pair{1, 2});  // twice
  expect(good.exclusions(), Pair{5, 9});  // not in order
  expect(good.exclusions(), Pair{1, 0});
  expect(good.live(), std::uint8_t{2});
  expect(good.live(), std::uint8_t{0});  // though it has a box
}

TEST(State, BytesThatNoStateHasAreRefused) {
  expect_bytes_that_no_state_has_are_refused<Aabb>();
  expect_bytes_that_no_state_has_are_refused<Aabb64>();
}

/// Bytes are refused, or are a state like any other.
template <class Box>
void expect_no_harm(const BroadPhase::Config& config) {
  const std::vector<std::byte> bytes = small_state<Box>().bytes();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE(error_of([&] { (void)BasicState<Box>::from_bytes(std::span(bytes).first(size)); }), "");
  }
  BasicBroadPhase<Box> broad_phase(config);
  BasicBroadPhase<Box> oracle({.algorithm = "oracle"});
  std::size_t restored = 0;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    for (const unsigned bits : {1U, 0x80U, 0xffU}) {
      std::vector<std::byte> changed = bytes;
      changed[at] ^= std::byte(bits);
      try {
        const auto state = BasicState<Box>::from_bytes(changed);
        (void)oracle.restore(state);
        (void)broad_phase.restore(state);
        ++restored;
      } catch (const Error&) {
        continue;
      }
      ASSERT_TRUE(same("pairs", broad_phase.pairs(), oracle.pairs())) << "byte " << at;
      const std::uint32_t id = oracle.add(Box{{0, 0, 0}, {1, 1, 1}});
      ASSERT_EQ(broad_phase.add(Box{{0, 0, 0}, {1, 1, 1}}), id);
      const Delta expected = oracle.update();
      ASSERT_TRUE(same(broad_phase.update(), expected.added, expected.removed)) << "byte " << at;
      EXPECT_EQ(broad_phase.save().bytes(), oracle.save().bytes());
    }
  }
  EXPECT_GT(restored, bytes.size());
}

TEST(State, DamagedBytesDoNoHarm) {
  expect_no_harm<Aabb>({.algorithm = "sweep-and-prune"});
  expect_no_harm<Aabb64>({.algorithm = "sweep-and-prune"});
}

NOT_IN(rusticl | sanitizers, "takes long; State.DamagedBytesDoNoHarm is in it");
TEST_P(EachAlgorithm, DamagedBytesDoNoHarm) {
  expect_no_harm<Aabb>(config());
  expect_no_harm<Aabb64>(config());
}

TEST(State, BytesAreFew) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  for (std::size_t k = 0; k < 800; ++k) broad_phase.add(apart(k));
  (void)broad_phase.update();
  EXPECT_LE(broad_phase.save().bytes().size(), 20'100U);
}

/// What was saved stays what it was, whoever has a copy, and so do its bytes.
TEST(State, StaysAsItIs) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  broad_phase.add(unit);
  broad_phase.set_exclusions(Pairs{{0, 1}});
  (void)broad_phase.update();
  std::optional<State> state = broad_phase.save();
  const std::vector<std::byte> bytes = state->bytes();
  const State copy = *state;
  const State moved = std::move(*state);
  state.reset();
  broad_phase.add(unit);
  broad_phase.set_exclusions({});
  (void)broad_phase.update();
  EXPECT_EQ(copy.bytes(), bytes);
  EXPECT_EQ(moved.bytes(), bytes);
  (void)broad_phase.restore(State::from_bytes(bytes));
  EXPECT_EQ(broad_phase.save().bytes(), bytes);
}

}  // namespace
}  // namespace broadcl::test
