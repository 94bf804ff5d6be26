#include <broadcl/mpi.hpp>

#include <mpi.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "boxes.hpp"
#include "expect_error.hpp"
#include "mpi_player.hpp"
#include "mpi_twins.hpp"
#include "random_scripts.hpp"

/// MpiBroadPhase against one device that has all objects. Started by mpirun with any number of ranks, which
/// all run the same tests at the same time; the first argument may name an algorithm.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

float uniform(Dice& dice, float lower, float upper) {
  return lower + (upper - lower) * static_cast<float>(dice.below(1U << 24U)) * 0x1p-24F;
}

/// A cube somewhere in the unit cube.
Aabb cube(Dice& dice, float edge) {
  Aabb box{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lower[axis] = uniform(dice, 0, 1);
    box.upper[axis] = box.lower[axis] + edge;
  }
  return box;
}

int any_rank(Dice& dice) {
  return static_cast<int>(dice.below(static_cast<unsigned>(world_size())));
}

/// @returns How many pairs began or ended.
std::size_t play(std::size_t scripts, std::uint64_t seed) {
  std::size_t changes = 0;
  check_scripts(algorithm_under_test, scripts, seed, [&] {
    const CoreScript script = *core_scripts(ScriptSize::small);
    MpiPlayer player(script);
    apply_each(script.ops, [&](const CoreOp& op) { player.apply(op); });
    player.twins().update();
    player.twins().compare_pairs();
    changes += player.twins().changes();
  });
  return changes;
}

TEST(Mpi, RandomCalls) {
  EXPECT_GT(play(static_cast<std::size_t>(frames(48) / world_size()), seed_of_ci), 1000U);
}

TEST(LongMpi, ManyRandomCalls) {
  std::uint64_t seed = std::random_device()();
  MPI_Bcast(&seed, 1, MPI_UINT64_T, 0, MPI_COMM_WORLD);
  play(100, seed);
}

TEST(Mpi, BoxesInMotionCrossRanks) {
  MpiTwins twins(config());
  Dice dice(rc::Random(3));
  constexpr std::uint32_t n = 200;
  std::vector<std::vector<Aabb>> boxes(static_cast<std::size_t>(world_size()), std::vector<Aabb>(n));
  std::vector<std::array<float, 3>> steps(n);
  for (auto& step : steps) step = {uniform(dice, -1, 1), uniform(dice, -1, 1), uniform(dice, -1, 1)};
  for (auto& of_rank : boxes) {
    for (Aabb& box : of_rank) box = cube(dice, 0.08F);
  }
  for (int frame = 0; frame < frames(40); ++frame) {
    for (int rank = 0; rank < world_size(); ++rank) {
      std::vector<Aabb>& of_rank = boxes[static_cast<std::size_t>(rank)];
      for (std::uint32_t id = 0; id < n; ++id) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          of_rank[id].lower[axis] += 0.02F * steps[id][axis];
          of_rank[id].upper[axis] += 0.02F * steps[id][axis];
        }
      }
      twins.map(rank, of_rank);
    }
    twins.update();
  }
  twins.compare_pairs();
  EXPECT_GT(twins.changes(), 400U);
}

/// So many boxes that several threads share the work. All objects of a rank are in its halo, except those
/// that are empty for a frame. Some are replaced, around the end of a part of the halo.
TEST(Mpi, ManyBoxesAreFoundInParts) {
  if (world_size() != 2 || algorithm_under_test != "sweep-and-prune") return;
  constexpr std::uint32_t n = 40000;
  Config several = config();
  several.threads = 3;
  MpiTwins twins(several, n);
  Dice dice(rc::Random(9));
  std::array<std::vector<Aabb>, 2> boxes{std::vector<Aabb>(n), std::vector<Aabb>(n)};
  for (auto& of_rank : boxes) {
    for (Aabb& box : of_rank) box = cube(dice, 0.02F);
  }
  for (std::uint32_t frame = 0; frame < 4; ++frame) {
    for (int rank = 0; rank < 2; ++rank) {
      std::vector<Aabb>& of_rank = boxes.at(static_cast<std::size_t>(rank));
      for (std::uint32_t id = 0; id < n; ++id) {
        const float step = id % 2 == 0 ? 0.002F : -0.002F;
        of_rank[id].lower[id % 3] += step;
        of_rank[id].upper[id % 3] += step;
      }
      std::vector<Aabb> given = of_rank;
      for (std::uint32_t id = frame; id < n; id += 7) given[id] = empty_aabb();
      twins.map(rank, given);
      for (std::uint32_t id = 2300; frame > 0 && id < 2450; ++id) {
        twins.remove(rank, id);
        const Filter filter{.group = 1U << (id + frame) % 2, .mask = 3};
        twins.add(rank, given[id], id % 3 == 0 ? filter : Filter());
      }
    }
    twins.update();
  }
  twins.compare_pairs();
  EXPECT_GT(twins.changes(), 20000U);
}

/// Objects of a rank in a place of their own.
void place_apart(MpiTwins& twins, Dice& dice, std::size_t objects) {
  for (int rank = 0; rank < world_size(); ++rank) {
    std::vector<Aabb> boxes(objects);
    for (Aabb& box : boxes) {
      box = cube(dice, 0.05F);
      box.lower[0] += static_cast<float>(10 * rank);
      box.upper[0] += static_cast<float>(10 * rank);
    }
    twins.map(rank, boxes);
  }
  twins.update();
}

/// The numbers of docs/mpi.md, for an object in the halo of another rank that has no pairs there.
TEST(Mpi, BytesSentAreThoseOfWhatChanged) {
  if (world_size() != 2) return;
  MpiTwins twins(config());
  Dice dice(rc::Random(10));
  place_apart(twins, dice, 100);
  const auto expect_to_other = [&](std::size_t bytes) {
    twins.update();
    EXPECT_EQ(twins.tested().bytes_sent(), world_rank() == 0 ? bytes : 0);
  };
  expect_to_other(0);
  constexpr std::size_t message = 48;
  const Aabb everywhere{{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
  const std::uint32_t id = twins.add(0, everywhere, {.mask = 0});
  expect_to_other(message + 44);
  expect_to_other(0);
  twins.move(0, id, {everywhere.lower, {infinity, infinity, 2}});
  expect_to_other(message + 28);
  twins.set_filter(0, id, {.group = 2, .mask = 0});
  expect_to_other(message + 20);
  twins.remove(0, id);
  expect_to_other(message + 4);
}

/// One that is far from the other objects of its rank, or far larger, makes only those near it be sent.
TEST(Mpi, AStrayObjectDoesNotBringAllToTheOtherRank) {
  if (world_size() != 2) return;
  for (const bool is_large : {false, true}) {
    MpiTwins twins(config());
    Dice dice(rc::Random(11));
    place_apart(twins, dice, 200);
    const Aabb stray =
        is_large ? Aabb{{-infinity, -infinity, -1}, {infinity, infinity, 0.01F}} : cube(dice, 0.1F);
    for (const int rank : {0, 1}) {
      Aabb box = stray;
      if (!is_large) {  // among the objects of the other rank
        for (auto* bound : {&box.lower, &box.upper}) (*bound)[0] += static_cast<float>(10 - 10 * rank);
      }
      twins.add(rank, box);
    }
    twins.update();
    EXPECT_LT(twins.tested().bytes_sent(), 48 + 44 * 30 + 1000U) << is_large;
    twins.compare_pairs();
  }
}

/// The bounds of a rank contain its objects even if the distances between these are no finite numbers.
TEST(Mpi, ObjectsAreAsFarApartAsFloatsCanBe) {
  MpiTwins twins(config());
  constexpr float most = std::numeric_limits<float>::max();
  for (int rank = 0; rank < world_size(); ++rank) {
    for (std::uint32_t k = 0; k < 20; ++k) {
      const float at = k % 2 == 0 ? -most : most;
      twins.add(rank, {{at, at, at}, {at, at, at}});
      twins.add(rank, {{-infinity, at, at}, {at, at, infinity}});
      const float end = k % 2 == 0 ? -infinity : infinity;
      twins.add(rank, {{end, at, end}, {end, at, end}});
    }
  }
  twins.update();
  for (int rank = 0; rank < world_size(); ++rank) twins.move(rank, 1, unit);
  twins.update();
  twins.compare_pairs();
}

TEST(Mpi, TheProfileHasThePartsOfTheSearch) {
  if (algorithm_under_test == "sweep-and-prune") return;
  MpiTwins twins(config());
  for (int rank = 0; rank < world_size(); ++rank) twins.map(rank, std::vector<Aabb>(2, unit));
  twins.update();
  const std::span<const Stage> stages = twins.tested().profile();
  const auto upload = std::ranges::find(stages, "upload", &Stage::name);
  const auto begin = std::ranges::find(stages, "begin", &Stage::name);
  ASSERT_LT(upload, begin);
  ASSERT_NE(begin, stages.end());
}

/// Two rows of objects that cross, each of a rank, with a gap where they do. Then an object of each rank goes
/// there.
TEST(Mpi, ObjectsMeetBetweenTheObjectsOfBothRanks) {
  MpiTwins twins(config());
  const auto in_row = [](std::size_t axis, float at) {
    Aabb box{{0, 0, 0}, {0.5F, 0.5F, 0.5F}};
    box.lower[axis] += at;
    box.upper[axis] += at;
    return box;
  };
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = -20; k <= 20; ++k) {
      if (std::abs(k) > 2) twins.add(rank, in_row(static_cast<std::size_t>(rank % 3), static_cast<float>(k)));
    }
  }
  twins.update();
  for (int rank = 0; rank < world_size(); ++rank) twins.move(rank, 5, in_row(0, 0));
  twins.update();
  if (world_size() <= 3) {
    EXPECT_EQ(twins.changes(), static_cast<std::size_t>(world_size() * (world_size() - 1) / 2));
  }
}

/// Each object goes from rank to rank: it is removed from one and added to the next.
TEST(Mpi, ObjectsJumpFromRankToRank) {
  MpiTwins twins(config());
  Dice dice(rc::Random(4));
  std::vector<std::pair<int, std::uint32_t>> objects;
  for (int k = 0; k < 60; ++k) {
    const int rank = any_rank(dice);
    objects.emplace_back(rank, twins.add(rank, cube(dice, 0.3F)));
  }
  twins.update();
  for (int frame = 0; frame < frames(20); ++frame) {
    for (auto& [rank, id] : objects) {
      if (dice.below(3) == 0) continue;
      twins.remove(rank, id);
      rank = (rank + 1) % world_size();
      id = twins.add(rank, cube(dice, 0.3F));
    }
    twins.update();
  }
  twins.compare_pairs();
}

TEST(Mpi, ARankBecomesEmptyAndGetsObjectsAgain) {
  MpiTwins twins(config());
  Dice dice(rc::Random(12));
  place_apart(twins, dice, 20);
  for (int rank = 0; rank < world_size(); ++rank) {
    twins.map(rank, {});
    twins.update();
    twins.map(rank, std::vector<Aabb>(7, unit));
    twins.update();
    twins.compare_pairs();
  }
}

/// In one update, halos become much larger than memory was allocated for.
TEST(Mpi, HalosOutgrowTheirMemory) {
  MpiTwins twins(config(), 3000);
  Dice dice(rc::Random(13));
  place_apart(twins, dice, 40);
  for (const std::size_t objects : {300U, 3000U, 1U, 2000U}) {
    for (int rank = 0; rank < world_size(); ++rank) {
      std::vector<Aabb> boxes(objects);
      for (Aabb& box : boxes) box = cube(dice, 0.03F);
      twins.map(rank, boxes);
    }
    twins.update();
  }
  twins.compare_pairs();
}

TEST(Mpi, ExclusionsOfObjectsOfOtherRanks) {
  MpiTwins twins(config());
  Dice dice(rc::Random(14));
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = 0; k < 12; ++k) twins.add(rank, cube(dice, 0.7F), {.body = dice.below(3)});
  }
  twins.update();
  for (int frame = 0; frame < frames(30); ++frame) {
    if (frame % 2 == 0) {
      std::vector<Pair> pairs;
      for (const MpiId b : twins.objects()) {
        for (const MpiId a : twins.objects()) {
          if (a < b && dice.one_in(3)) pairs.push_back({twins.slot(a), twins.slot(b)});
        }
      }
      twins.set_exclusions(pairs);
    }
    if (frame % 3 == 0) twins.set_filter(any_rank(dice), dice.below(12), {.body = dice.below(3)});
    if (frame % 5 == 0) twins.move(any_rank(dice), dice.below(12), cube(dice, 0.7F));
    twins.update();
    twins.compare_pairs();
  }
  const int other = (world_rank() + 1) % world_size();
  if (world_size() > 1) {
    const MpiPair pair{mpi_id(other, 0), mpi_id(other, 1)};
    EXPECT_THAT(error_of([&] {
                  twins.tested().set_exclusions({&pair, 1});
                }),
                HasSubstr("give the pair on rank " + std::to_string(other)));
  }
}

TEST(Mpi, AllObjectsOfOneRank) {
  for (const int rank : {0, world_size() - 1}) {
    MpiTwins twins(config());
    Dice dice(rc::Random(5));
    twins.update();
    twins.compare_pairs();
    for (std::uint32_t id = 0; id < 200; ++id) twins.add(rank, cube(dice, 0.2F));
    twins.update();
    for (int frame = 0; frame < frames(10); ++frame) {
      for (std::uint32_t id = 0; id < 200; id += 7) twins.move(rank, id, cube(dice, 0.2F));
      twins.update();
    }
    twins.compare_pairs();
    for (std::uint32_t id = 0; id < 200; ++id) twins.remove(rank, id);
    twins.update();
    twins.compare_pairs();
  }
}

TEST(Mpi, AllBoxesAtOnePlace) {
  MpiTwins twins(config());
  const Aabb place{{1, 2, 3}, {2, 3, 4}};
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = 0; k < 20; ++k) twins.add(rank, place);
  }
  for (int frame = 0; frame < 3; ++frame) twins.update();
  for (int rank = 0; rank < world_size(); ++rank) {
    for (std::uint32_t id = 0; id < 20; ++id) twins.move(rank, id, {{-1, -2, -3}, {0, 0, 0}});
  }
  twins.update();
  twins.compare_pairs();
}

TEST(Mpi, TwoSets) {
  MpiTwins twins(config());
  Dice dice(rc::Random(6));
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = 0; k < 100; ++k)
      twins.add(rank, cube(dice, 0.2F), k % 3 == 0 ? Filter::first_set : Filter::second_set);
  }
  for (int frame = 0; frame < frames(10); ++frame) {
    for (std::uint32_t id = 0; id < 100; id += 3) twins.move(any_rank(dice), id, cube(dice, 0.2F));
    twins.update();
  }
  twins.compare_pairs();
}

TEST(Mpi, AnObjectThatTakesTheIdOfAnotherIsAnother) {
  MpiTwins twins(config());
  const Aabb place{{0, 0, 0}, {1, 1, 1}};
  const int last = world_size() - 1;
  for (int k = 0; k < 3; ++k) {
    twins.add(0, place);
    twins.add(last, place);
  }
  twins.update();
  for (const int rank : {0, last}) {
    twins.remove(rank, 1);
    twins.add(rank, place);
  }
  const auto delta = twins.tested().update();
  EXPECT_EQ(delta.removed.empty() && read(twins.tested(), delta.own.removed).empty(),
            world_rank() != 0 && world_rank() != last);
  twins.compare(delta);
}

}  // namespace
}  // namespace broadcl::test

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  ::testing::InitGoogleMock(&argc, argv);
  if (argc > 1) broadcl::test::algorithm_under_test = argv[1];
  const int result = RUN_ALL_TESTS();
  MPI_Finalize();
  return result;
}
