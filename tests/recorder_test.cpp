// What BROADCL_RECORD makes objects write, and that it has the pairs of their updates.
#include "core/recorder.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broadcl.h>
#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "boxes.hpp"
#include "cli/recording.hpp"
#include "environment.hpp"
#include "scenes/recorded_objects.hpp"

namespace broadcl::test {
namespace {

namespace fs = std::filesystem;
using Lists = std::vector<std::vector<Pair>>;  // one per update

void append_changes(const Delta& delta, Lists& lists) {
  lists.emplace_back(delta.added.begin(), delta.added.end());
  lists.emplace_back(delta.removed.begin(), delta.removed.end());
}

class BroadclRecord : public testing::Test {
 protected:
  [[nodiscard]] std::string path(const std::string& name = "run") const {
    return (folder_.path() / name).string();
  }

  /// The pairs of each frame of a file, as the oracle finds them.
  /// @param changes Gets those that were added, and those that were removed.
  template <class Box = Aabb>
  [[nodiscard]] Lists replayed(const std::string& name = "run", Lists* changes = nullptr) const {
    const ScopedVariable unset("BROADCL_RECORD", "");
    cli::RecordingReader reader(path(name));
    EXPECT_EQ(reader.is_double(), (std::is_same_v<Box, Aabb64>));
    BasicBroadPhase<Box> oracle({.algorithm = "oracle", .distance = reader.distance()});
    Lists lists;
    for (std::uint32_t frame = 0; frame < reader.frames(); ++frame) {
      scenes::set_objects(oracle, reader.next());
      const Delta delta = oracle.update();
      if (changes != nullptr) append_changes(delta, *changes);
      lists.push_back(oracle.pairs());
    }
    return lists;
  }

  /// What is printed to stderr while a function is called.
  template <class Function>
  static std::string printed(const Function& function) {
    testing::internal::CaptureStderr();
    function();
    return testing::internal::GetCapturedStderr();
  }

  static void update_once(const Config& config = {.algorithm = "sweep-and-prune"}) {
    BroadPhase broad_phase(config);
    broad_phase.add(unit);
    (void)broad_phase.update();
  }

 private:
  ScopedFolder folder_;
  ScopedVariable variable_{"BROADCL_RECORD", path()};
};

/// Does what programs do with an object, at random.
template <class Box>
class Script {
 public:
  explicit Script(const Config& config) : broad_phase_(config) {}

  /// @returns The pairs of each update.
  Lists play(int updates) {
    Lists lists;
    for (int k = 0; k < updates; ++k) {
      for (int change = 0; change < 8; ++change) change_something();
      append_changes(update(), changes);
      lists.push_back(broad_phase_.pairs());
    }
    return lists;
  }

  Lists changes;

 private:
  std::uint32_t up_to(std::uint32_t n) { return std::uniform_int_distribution(0U, n)(random_); }

  Box box() {
    Box box;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = BoundType<Box>(up_to(14)) / 7;
      box.upper[axis] = box.lower[axis] + BoundType<Box>(up_to(8)) / 7;
    }
    if (up_to(9) == 0) box.upper[0] = -1;
    return box;
  }
  std::vector<Box> boxes() {
    std::vector<Box> boxes(20 + up_to(40));
    for (Box& b : boxes) b = box();
    return boxes;
  }
  Filter filter() {
    return {.group = 1 + up_to(2), .mask = up_to(3), .body = up_to(9) - 1, .world = up_to(2) - 1};
  }
  std::optional<std::uint32_t> some_id() {
    const std::uint32_t id = up_to(60);
    return broad_phase_.contains(id) ? std::optional(id) : std::nullopt;
  }

  void change_something() {
    const auto id = some_id();
    switch (up_to(7)) {
      case 0:
        broad_phase_.add(box(), filter(), BoundType<Box>(up_to(2)));
        break;
      case 1:
        if (id) broad_phase_.remove(*id);
        break;
      case 2:
        if (id) broad_phase_.set_filter(*id, filter());
        break;
      case 3:
        if (const BoundType<Box> reach = 1; id) broad_phase_.set_reach({&*id, 1}, {&reach, 1});
        break;
      case 4: {
        const std::vector<Pair> exclusions = {{up_to(20), 21 + up_to(20)}, {1, 2}};
        broad_phase_.set_exclusions(exclusions);
        break;
      }
      case 5:
        if (id) replace(*id);
        break;
      default:
        if (id) broad_phase_.move(*id, box());
    }
  }

  /// By an object like it, which has the same id unless a lower one is free.
  void replace(std::uint32_t id) {
    const Box box = broad_phase_.box(id);
    const Filter filter = broad_phase_.filter(id);
    const BoundType<Box> reach = broad_phase_.reach(id);
    broad_phase_.remove(id);
    broad_phase_.add(box, filter, reach);
  }

  Delta update() {
    switch (up_to(6)) {
      case 0: {
        const std::vector<Box> all = boxes();
        return broad_phase_.update(all);
      }
      case 1: {
        const std::vector<Box> all = boxes();
        std::ranges::copy(all, broad_phase_.map(all.size()).begin());
        return broad_phase_.update();
      }
      case 2: {
        const std::vector<Box> all = boxes();
        broad_phase_.begin(all);
        change_something();
        return broad_phase_.finish();
      }
      case 3:
        broad_phase_.begin();
        for (int k = 0; k < 4; ++k) change_something();
        return broad_phase_.finish();
      case 4:
        if (up_to(4) > 0 && !states_.empty())
          return broad_phase_.restore(states_[up_to(60) % states_.size()]);
        [[fallthrough]];
      case 5: {
        Delta delta = broad_phase_.update();
        states_.push_back(broad_phase_.save());
        return delta;
      }
      default:
        return broad_phase_.update();
    }
  }

  std::mt19937 random_;
  BasicBroadPhase<Box> broad_phase_;
  std::vector<BasicState<Box>> states_;
};

template <class Box>
void expect_replayed(const std::string& algorithm, const auto& replayed) {
  Script<Box> script({.algorithm = algorithm});
  const Lists pairs = script.play(60);
  Lists changes;
  EXPECT_EQ(pairs, replayed(changes));
  EXPECT_EQ(script.changes, changes);
}

TEST_F(BroadclRecord, HasThePairsOfEachUpdate) {
  for (const std::string algorithm : {"auto", "sweep-and-prune", "tiles"}) {
    SCOPED_TRACE(algorithm);
    const ScopedVariable variable("BROADCL_RECORD", path(algorithm));
    expect_replayed<Aabb>(algorithm, [&](Lists& changes) { return replayed(algorithm, &changes); });
    expect_replayed<Aabb64>(algorithm,
                            [&](Lists& changes) { return replayed<Aabb64>(algorithm + ".2", &changes); });
  }
}

TEST_F(BroadclRecord, HasTheDistance) {
  BroadPhase64 broad_phase({.algorithm = "sweep-and-prune", .distance = 1});
  const std::array boxes{apart(0), apart(1), apart(2)};
  broad_phase.add(boxes);
  (void)broad_phase.update();
  EXPECT_THAT(replayed<Aabb64>(), testing::ElementsAre(testing::ElementsAre(Pair{0, 1}, Pair{1, 2})));
}

/// A device receives the boxes of the second update while they are being copied.
TEST_F(BroadclRecord, HasBoxesThatAllMove) {
  constexpr std::size_t n = 5000;
  BroadPhase broad_phase({.algorithm = "tiles"});
  for (const float x : {0.F, 1.F, 3.F}) {
    const std::vector<Aabb> boxes(n, Aabb{{x, x, x}, {x, x, x}});
    (void)broad_phase.update(boxes);
  }
  cli::RecordingReader reader(path());
  for (const float x : {0.F, 1.F, 3.F})
    EXPECT_EQ(reader.next().boxes, std::vector<Aabb>(n, Aabb{{x, x, x}, {x, x, x}}));
}

TEST_F(BroadclRecord, TheInterfaceOfCRecords) {
  broadcl_config config{};
  config.size = sizeof(config);
  config.algorithm = "sweep-and-prune";
  broadcl_broad_phase* broad_phase = nullptr;
  ASSERT_EQ(broadcl_broad_phase_create(&config, &broad_phase), BROADCL_SUCCESS);
  const std::vector<float> numbers = {0, 0, 0, 1, 1, 1, 1, 1, 1, 2, 2, 2};
  broadcl_boxes boxes{};
  boxes.size = sizeof(boxes);
  boxes.data = numbers.data();
  boxes.count = 2;
  broadcl_delta delta{};
  EXPECT_EQ(broadcl_broad_phase_update_boxes(broad_phase, &boxes, &delta), BROADCL_SUCCESS);
  EXPECT_EQ(broadcl_broad_phase_destroy(broad_phase), BROADCL_SUCCESS);
  EXPECT_THAT(replayed(), testing::ElementsAre(testing::ElementsAre(Pair{0, 1})));
}

/// What failed and was undone may be in the recording; the frames after it are right.
TEST_F(BroadclRecord, AnUpdateThatFailsDoesNoHarm) {
  BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
  broad_phase.add(unit, {.world = 1});
  broad_phase.add(unit, {.world = 2});
  (void)broad_phase.update();
  const std::vector<Aabb> with_nan = {unit, {{nan_value, 0, 0}, {1, 1, 1}}, unit};
  EXPECT_THROW((void)broad_phase.update(with_nan), Error);
  broad_phase.set_filter(0, {.world = 2});
  (void)broad_phase.update();
  EXPECT_EQ(replayed().back(), broad_phase.pairs());
  EXPECT_EQ(broad_phase.pairs().size(), 1U);
}

TEST_F(BroadclRecord, ObjectsOfSeveralThreadsHaveTheirFiles) {
  std::array<std::thread, 4> threads;
  for (std::thread& thread : threads) thread = std::thread([] { update_once(); });
  for (std::thread& thread : threads) thread.join();
  for (const std::string name : {"run", "run.2", "run.3", "run.4"})
    EXPECT_EQ(replayed(name), Lists(1)) << name;
}

TEST_F(BroadclRecord, NothingIsWrittenWithoutUpdatesOrVariable) {
  BroadPhase({.algorithm = "sweep-and-prune"}).add(unit);
  const std::array boxes{unit, unit};
  (void)overlapping_pairs(boxes);
  const ScopedVariable unset("BROADCL_RECORD", "");
  update_once();
  EXPECT_FALSE(fs::exists(path()));
}

TEST_F(BroadclRecord, EndsBeforeTheLimit) {
  const ScopedVariable limit("BROADCL_RECORD_LIMIT", "250");
  EXPECT_EQ(printed([] {
              BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
              broad_phase.add(unit);
              for (int k = 0; k < 9; ++k) (void)broad_phase.update();
            }),
            "broadcl: BROADCL_RECORD: '" + path() +
                "' would exceed 250 bytes (BROADCL_RECORD_LIMIT); nothing more of this object is recorded\n");
  EXPECT_LE(fs::file_size(path()), 250U);
  EXPECT_EQ(replayed(), Lists(3));
}

TEST_F(BroadclRecord, WhatCannotBeWrittenIsALineAndTheUpdateSucceeds) {
  const std::string end = "; nothing more of this object is recorded\n";
  {
    const ScopedVariable variable("BROADCL_RECORD", path("missing/run"));
    EXPECT_THAT(printed([] { update_once(); }),
                testing::AllOf(testing::StartsWith("broadcl: BROADCL_RECORD: cannot write '" +
                                                   path("missing/run") + "': "),
                               testing::EndsWith(end)));
  }
  const ScopedVariable limit("BROADCL_RECORD_LIMIT", "1 GiB");
  EXPECT_EQ(printed([] { update_once(); }),
            "broadcl: BROADCL_RECORD: BROADCL_RECORD_LIMIT is '1 GiB', which is not a number of bytes" + end);
  EXPECT_FALSE(fs::exists(path()));
}

}  // namespace
}  // namespace broadcl::test
