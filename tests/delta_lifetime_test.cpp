#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <new>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "engines/change_lists.hpp"
#include "failing_opencl.hpp"
#include "kept_delta.hpp"
#include "runs.hpp"

/// A Delta stays as it is until the next finish() or update().
namespace broadcl::test {
namespace {

TEST_P(EachAlgorithm, ADeltaOutlivesBeginAndWhatTheDeviceDoesThen) {
  const std::uint32_t n = is_slow() ? 100 : 300;
  BroadPhase broad_phase(config());
  for (std::uint32_t k = 0; k < n; ++k) broad_phase.add(unit);
  Delta delta = broad_phase.update();
  ASSERT_EQ(delta.added.size(), n * (n - 1) / 2);
  for (int frame = 0; frame < 9; ++frame) {
    const Pairs added = to_vector(delta.added);
    const Pairs removed = to_vector(delta.removed);
    EXPECT_GE(added.size() + removed.size(), n / 3);
    const auto expect_unchanged = [&](const char* what) {
      EXPECT_TRUE(same(delta, added, removed)) << what << ", frame " << frame;
    };
    // Apart, together, in twos: the lists become equally long, or much shorter.
    for (std::uint32_t id = 0; id < n; ++id) {
      broad_phase.move(id, frame % 3 == 0 ? apart(id) : frame % 3 == 1 ? unit : apart(id / 2));
    }
    EXPECT_GE(broad_phase.pairs().size(), added.size());
    expect_unchanged("pairs()");
    broad_phase.set_filter(1, {.mask = frame % 2 == 0 ? 0U : 1U});
    broad_phase.begin();
    expect_unchanged("begin()");
    if (broad_phase.device() != nullptr) wait_for_last_queue();
    expect_unchanged("the update on the device");
    if (frame % 2 == 0) {
      broad_phase.remove(0);
      EXPECT_EQ(broad_phase.add(unit), 0U);
      broad_phase.move(2, apart(3));
      for (int k = 0; k < 500; ++k) broad_phase.add(apart(n + 1));
      for (std::uint32_t id = n + 500; id-- > n;) broad_phase.remove(id);
      expect_unchanged("changes after begin()");
    }
    delta = broad_phase.finish();
  }
}

/// map() may get new memory for the boxes.
TEST_P(EachAlgorithm, ADeltaOutlivesMap) {
  BroadPhase broad_phase(config());
  for (Aabb& box : broad_phase.map(100)) box = unit;
  const Delta delta = broad_phase.update();
  for (Aabb& box : broad_phase.map(5000)) box = apart(7);
  EXPECT_TRUE(same(delta, all_pairs(100), {}));
}

/// One caller keeps all deltas, one the last two, one only the last.
TEST_P(EachAlgorithm, KeptDeltasOutliveUpdatesAndTheObject) {
  constexpr std::uint32_t n = 60;
  for (const std::size_t most : {std::size_t{20}, std::size_t{2}, std::size_t{1}}) {
    std::deque<KeptDelta> deltas;
    std::optional<BroadPhase> broad_phase(config());
    for (std::uint32_t k = 0; k < n; ++k) broad_phase->add(unit);
    for (int frame = 0; frame < 12; ++frame) {
      if (frame % 5 == 4) broad_phase->begin();
      const Delta delta = broad_phase->update();
      deltas.emplace_back(delta, broad_phase->delta_memory());
      EXPECT_GT(deltas.back().added.size() + deltas.back().removed.size(), n / 3);
      EXPECT_NE(deltas.back().memory, nullptr);
      if (deltas.size() > most) deltas.pop_front();
      for (const KeptDelta& kept : deltas) ASSERT_TRUE(kept.is_unchanged()) << most << ", frame " << frame;
      for (std::uint32_t id = 0; id < n; ++id) {
        broad_phase->move(id, frame % 3 == 0 ? apart(id) : frame % 3 == 1 ? unit : apart(id / 2));
      }
    }
    broad_phase.reset();
    for (const KeptDelta& kept : deltas) ASSERT_TRUE(kept.is_unchanged()) << most << ", afterwards";
  }
}

/// The lists are told apart by their capacity, since freed memory may be allocated again.
TEST(ChangeLists, AreThoseOfAnEarlierUpdateThatNobodyKeeps) {
  ChangeLists lists;
  const auto next_capacity = [&] {
    std::size_t capacity = 0;
    lists.fill([&](Pairs& added, Pairs& /*removed*/) { capacity = added.capacity(); });
    lists.commit();
    return capacity;
  };
  const auto reserve = [&](std::size_t n) {
    lists.fill([&](Pairs& added, Pairs& /*removed*/) { added.reserve(n); });
  };
  reserve(10);
  EXPECT_EQ(next_capacity(), 10U);
  std::shared_ptr<const void> kept = lists.owner();
  EXPECT_EQ(next_capacity(), 0U);
  reserve(20);
  kept = lists.owner();
  EXPECT_EQ(next_capacity(), 10U);
  const std::shared_ptr<const void> kept_too = lists.owner();
  EXPECT_EQ(next_capacity(), 0U);
}

TEST(ChangeLists, OfAnUpdateThatFailsAreNotThoseOfTheLastOne) {
  ChangeLists lists;
  lists.fill([](Pairs& added, Pairs& /*removed*/) { added.push_back({1, 2}); });
  lists.commit();
  const std::shared_ptr<const void> kept = lists.owner();
  EXPECT_THROW(lists.fill([](Pairs& added, Pairs& /*removed*/) {
    EXPECT_TRUE(added.empty());
    added.reserve(100);
    throw std::bad_alloc();
  }),
               std::bad_alloc);
  EXPECT_EQ(lists.owner(), kept);
  lists.commit();  // of an update that has other lists
  EXPECT_EQ(lists.owner(), kept);
  lists.fill([](Pairs& added, Pairs& /*removed*/) { EXPECT_LT(added.capacity(), 100U); });
}

NOT_IN(rusticl, "version 25.0 maps a buffer to another address each time");
TEST_P(EachAlgorithm, MemoryOfDeltasThatNobodyKeepsIsUsedAgain) {
  BroadPhase broad_phase(config());
  broad_phase.add(unit);
  const std::uint32_t id = broad_phase.add(unit);
  std::set<const Pair*> memory;
  for (int frame = 0; frame < 12; ++frame) {
    const Delta delta = broad_phase.update();
    ASSERT_EQ(delta.added.size() + delta.removed.size(), 1U);
    memory.insert(delta.added.empty() ? delta.removed.data() : delta.added.data());
    const auto owner = broad_phase.delta_memory();  // until the next frame
    broad_phase.move(id, frame % 2 == 0 ? apart(3) : unit);
  }
  // Two buffers of two lists. (The device may have got more memory after the first frame.)
  EXPECT_LE(memory.size(), 6U);
  EXPECT_EQ(broad_phase.update().removed.size(), 0U);
  EXPECT_EQ(broad_phase.update().added.size(), 0U);
  EXPECT_EQ(broad_phase.delta_memory(), nullptr) << "nothing had moved";
}

}  // namespace
}  // namespace broadcl::test
