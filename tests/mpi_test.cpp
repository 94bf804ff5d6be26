#include <broadcl/mpi.hpp>

#include <mpi.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "boxes.hpp"
#include "failing_allocations.hpp"
#include "failing_opencl.hpp"
#include "mpi_twins.hpp"

/// MpiBroadPhase against one device that has all objects. Started by mpirun with any number of ranks, which
/// all run the same tests at the same time; the first argument may name an algorithm.
namespace broadcl::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string algorithm_under_test = "sweep-and-prune";

/// Fewer frames if the device is a CPU.
int frames(int on_the_host) {
  return algorithm_under_test == "sweep-and-prune" ? on_the_host : on_the_host / 8 + 2;
}

Config config() {
  return {.algorithm = algorithm_under_test, .threads = 2};
}

/// The same random numbers on every rank.
class Dice {
 public:
  explicit Dice(std::uint32_t seed) : engine_(seed) {}

  std::uint32_t below(std::uint32_t end) { return static_cast<std::uint32_t>(engine_() % end); }
  float uniform(float lower, float upper) {
    return lower + (upper - lower) * static_cast<float>(engine_() >> 8U) * 0x1p-24F;
  }
  int rank() { return static_cast<int>(below(static_cast<std::uint32_t>(world_size()))); }

  Aabb cube(float edge, float world = 1) {
    Aabb box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = uniform(0, world);
      box.upper[axis] = box.lower[axis] + edge;
    }
    return box;
  }
  /// On a lattice, so that boxes touch each other and the bounds of ranks.
  Aabb on_lattice() {
    Aabb box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = static_cast<float>(below(7)) - 3;
      box.upper[axis] = box.lower[axis] + static_cast<float>(below(3));
    }
    return box;
  }
  Aabb any() {
    switch (below(16)) {
      case 0:
        return empty_aabb();
      case 1: {  // half of space
        Aabb box = cube(0.1F);
        (below(2) == 0 ? box.lower : box.upper)[below(3)] = below(2) == 0 ? -infinity : infinity;
        return box;
      }
      case 2:
        return {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
      case 3:  // at the end of space
        return {{infinity, 0.5F, 0.5F}, {infinity, 0.6F, 0.6F}};
      case 4:
        return {{-infinity, 0, 0}, {-infinity, 1, 1}};
      case 5:
        return cube(1.5F);
      case 6:
        return cube(0);
      case 7:
      case 8:
      case 9:
        return on_lattice();
      default:
        return cube(0.2F);
    }
  }
  Filter filter() {
    return {.group = 1U << below(3),
            .mask = below(8),
            .body = below(4) == 0 ? below(4) : Filter::no_body,
            .world = below(4) == 0 ? Filter::all_worlds : below(2)};
  }

 private:
  std::mt19937 engine_;
};

template <class Function>
std::string error_of(const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// The same on all ranks, so that none stops while others continue.
bool has_failed() {
  int failed = ::testing::Test::HasFailure() ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  return failed != 0;
}

/// Does something random to an object of a random rank.
void do_anything(MpiTwins& twins, Dice& dice, bool filters) {
  const int rank = dice.rank();
  const std::uint32_t id = dice.below(48);
  const std::uint32_t what = dice.below(8);
  const Aabb box = dice.any();
  const Filter filter = filters && dice.below(2) == 0 ? dice.filter() : Filter();
  if (!twins.is_live(rank, id)) {
    twins.add(rank, box, filter);
  } else if (what == 0) {
    twins.remove(rank, id);
  } else if (what == 1) {  // its id for another object
    twins.remove(rank, id);
    twins.add(rank, box, filter);
  } else if (what == 2) {
    twins.set_filter(rank, id, filter);
  } else {
    twins.move(rank, id, box);
  }
}

/// Writes the boxes of all objects of each rank, in place if their number is unchanged and nothing else
/// changed.
void map_all(MpiTwins& twins, Dice& dice) {
  for (int rank = 0; rank < world_size(); ++rank) {
    std::vector<Aabb> boxes(20);
    for (Aabb& box : boxes) box = dice.any();
    twins.map(rank, boxes);
  }
}

void play_random_calls(std::uint32_t seed, bool filters, int updates) {
  SCOPED_TRACE("seed " + std::to_string(seed));
  MpiTwins twins(config());
  Dice dice(seed);
  for (int k = 0; k < updates && !has_failed(); ++k) {
    const std::uint32_t calls = dice.below(3) == 0 ? dice.below(200) : dice.below(6);
    for (std::uint32_t call = 0; call < calls; ++call) do_anything(twins, dice, filters);
    if (dice.below(8) == 0) {
      std::vector<Aabb> boxes(dice.below(60));
      for (Aabb& box : boxes) box = dice.any();
      const int rank = dice.rank();
      twins.map(rank, boxes);
      for (; dice.below(2) == 0; twins.map(rank, boxes)) {
        twins.update();
        if (!boxes.empty()) boxes[dice.below(static_cast<std::uint32_t>(boxes.size()))] = dice.any();
      }
      if (dice.below(4) == 0) do_anything(twins, dice, filters);
    }
    if (filters && dice.below(8) == 0) {
      const std::uint32_t one_of = 1 + dice.below(12);
      twins.set_exclusions(16, [&] { return dice.below(one_of) == 0; });
    }
    twins.update();
    if (dice.below(8) == 0) twins.compare_pairs();
  }
  EXPECT_GT(twins.changes(), 1000U);
}

TEST(Mpi, RandomCalls) {
  play_random_calls(1, false, frames(120));
}

TEST(Mpi, RandomCallsWithFiltersAndWorlds) {
  play_random_calls(2, true, frames(120));
}

TEST(LongMpi, ManyRandomCalls) {
  for (std::uint32_t seed = 10; seed < 40 && !has_failed(); ++seed) {
    play_random_calls(seed, seed % 2 == 0, frames(400));
  }
}

TEST(Mpi, BoxesInMotionCrossRanks) {
  MpiTwins twins(config());
  Dice dice(3);
  constexpr std::uint32_t n = 200;
  std::vector<std::vector<Aabb>> boxes(static_cast<std::size_t>(world_size()), std::vector<Aabb>(n));
  std::vector<std::array<float, 3>> steps(n);
  for (auto& step : steps) step = {dice.uniform(-1, 1), dice.uniform(-1, 1), dice.uniform(-1, 1)};
  for (auto& of_rank : boxes) {
    for (Aabb& box : of_rank) box = dice.cube(0.08F);
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

/// So many boxes that several threads share the work.
TEST(Mpi, ManyBoxesAreFoundInParts) {
  if (world_size() != 2 || algorithm_under_test != "sweep-and-prune") return;
  constexpr std::uint32_t n = 40000;
  MpiTwins twins(config(), n);
  Dice dice(9);
  std::array<std::vector<Aabb>, 2> boxes{std::vector<Aabb>(n), std::vector<Aabb>(n)};
  for (auto& of_rank : boxes) {
    for (Aabb& box : of_rank) box = dice.cube(0.02F);
  }
  for (int frame = 0; frame < 3; ++frame) {
    for (int rank = 0; rank < 2; ++rank) {
      std::vector<Aabb>& of_rank = boxes.at(static_cast<std::size_t>(rank));
      for (std::uint32_t id = 0; id < n; ++id) {
        const float step = id % 2 == 0 ? 0.002F : -0.002F;
        of_rank[id].lower[id % 3] += step;
        of_rank[id].upper[id % 3] += step;
      }
      twins.map(rank, of_rank);
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
      box = dice.cube(0.05F);
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
  Dice dice(10);
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
    Dice dice(11);
    place_apart(twins, dice, 200);
    const Aabb stray =
        is_large ? Aabb{{-infinity, -infinity, -1}, {infinity, infinity, 0.01F}} : dice.cube(0.1F);
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
  Dice dice(4);
  std::vector<std::pair<int, std::uint32_t>> objects;
  for (int k = 0; k < 60; ++k) {
    const int rank = dice.rank();
    objects.emplace_back(rank, twins.add(rank, dice.cube(0.3F)));
  }
  twins.update();
  for (int frame = 0; frame < frames(20); ++frame) {
    for (auto& [rank, id] : objects) {
      if (dice.below(3) == 0) continue;
      twins.remove(rank, id);
      rank = (rank + 1) % world_size();
      id = twins.add(rank, dice.cube(0.3F));
    }
    twins.update();
  }
  twins.compare_pairs();
}

TEST(Mpi, ARankBecomesEmptyAndGetsObjectsAgain) {
  MpiTwins twins(config());
  Dice dice(12);
  map_all(twins, dice);
  twins.update();
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
  Dice dice(13);
  place_apart(twins, dice, 40);
  for (const std::size_t objects : {300U, 3000U, 1U, 2000U}) {
    for (int rank = 0; rank < world_size(); ++rank) {
      std::vector<Aabb> boxes(objects);
      for (Aabb& box : boxes) box = dice.cube(0.03F);
      twins.map(rank, boxes);
    }
    twins.update();
  }
  twins.compare_pairs();
}

TEST(Mpi, ExclusionsOfObjectsOfOtherRanks) {
  MpiTwins twins(config());
  Dice dice(14);
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = 0; k < 12; ++k) twins.add(rank, dice.cube(0.7F), {.body = dice.below(3)});
  }
  twins.update();
  for (int frame = 0; frame < frames(30); ++frame) {
    if (frame % 2 == 0) {
      twins.set_exclusions(12, [&] { return dice.below(3) == 0; });
    }
    if (frame % 3 == 0) twins.set_filter(dice.rank(), dice.below(12), {.body = dice.below(3)});
    if (frame % 5 == 0) twins.move(dice.rank(), dice.below(12), dice.cube(0.7F));
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
    Dice dice(5);
    twins.update();
    twins.compare_pairs();
    for (std::uint32_t id = 0; id < 200; ++id) twins.add(rank, dice.cube(0.2F));
    twins.update();
    for (int frame = 0; frame < frames(10); ++frame) {
      for (std::uint32_t id = 0; id < 200; id += 7) twins.move(rank, id, dice.cube(0.2F));
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
  Dice dice(6);
  for (int rank = 0; rank < world_size(); ++rank) {
    for (int k = 0; k < 100; ++k)
      twins.add(rank, dice.cube(0.2F), k % 3 == 0 ? Filter::first_set : Filter::second_set);
  }
  for (int frame = 0; frame < frames(10); ++frame) {
    for (std::uint32_t id = 0; id < 100; id += 3) twins.move(dice.rank(), id, dice.cube(0.2F));
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
  const MpiDelta delta = twins.tested().update();
  EXPECT_EQ(delta.removed.empty() && delta.own.removed.empty(), world_rank() != 0 && world_rank() != last);
  twins.compare(delta);
}

TEST(Mpi, ANaNIsNamedOnAllRanksAndMended) {
  MpiTwins twins(config());
  const int last = world_size() - 1;
  for (int rank = 0; rank <= last; ++rank) twins.map(rank, std::vector(5, unit));
  twins.update();
  if (world_rank() == last) {
    twins.tested().map(5)[3].upper[1] = nan_value;
    EXPECT_THAT(error_of([&] {
                  twins.tested().move(2, {{0, 0, 0}, {std::nanf(""), 1, 1}});
                }),
                HasSubstr("NaN"));
  }
  for (int time = 0; time < 2; ++time) {
    EXPECT_THAT(error_of([&] { (void)twins.tested().update(); }),
                AllOf(StartsWith("rank " + std::to_string(last) + ": "), HasSubstr("box 3 has a NaN")));
    try {
      (void)twins.tested().update();
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::invalid_argument) << "on every rank";
    }
    twins.compare_pairs();
  }
  twins.move(last, 3, {{5, 5, 5}, {6, 6, 6}});
  twins.update();
  twins.compare_pairs();
  for (int rank = 0; rank <= last; ++rank) twins.map(rank, std::vector(5, unit));
  twins.update();
  if (world_rank() == last) {
    const std::span<Aabb> boxes = twins.tested().map(5);
    std::ranges::fill(boxes, Aabb{{7, 7, 7}, {8, 8, 8}});
    boxes[1].lower[0] = nan_value;
  }
  EXPECT_THAT(error_of([&] { (void)twins.tested().update(); }), HasSubstr("box 1 has a NaN"));
  twins.compare_pairs();
  if (world_rank() == last) {
    const std::span<Aabb> boxes = twins.tested().map(5);
    for (const std::size_t id : {0U, 2U, 3U, 4U}) EXPECT_EQ(boxes[id].lower[0], 7);
    EXPECT_TRUE(std::isnan(boxes[1].lower[0]));
    std::ranges::fill(boxes, unit);
  }
  twins.update();
  twins.compare_pairs();
}

TEST(Mpi, UnknownIdsAreRefused) {
  MpiBroadPhase tested(MPI_COMM_WORLD, config());
  EXPECT_THAT(error_of([&] { tested.move(0, empty_aabb()); }), HasSubstr("no object has the id 0"));
  EXPECT_THAT(error_of([&] { tested.remove(7); }), HasSubstr("the id 7"));
  EXPECT_THAT(error_of([&] { tested.set_filter(1, Filter::first_set); }), HasSubstr("the id 1"));
}

TEST(Mpi, AnAlgorithmThatOneRankDoesNotKnowIsRefusedOnAll) {
  const int last = world_size() - 1;
  Config wrong = config();
  if (world_rank() == last) wrong.algorithm = "guesswork";
  EXPECT_THAT(error_of([&] { const MpiBroadPhase tested(MPI_COMM_WORLD, wrong); }),
              AllOf(StartsWith("rank " + std::to_string(last) + ": "), HasSubstr("guesswork")));
}

/// Updates while something fails on one rank, and then again: all ranks must report the failure, know the
/// last state, and continue.
/// @param make_failing Returns an object that makes something fail while it exists.
/// @returns Whether it failed.
template <class MakeFailing>
bool update_in_trouble(MpiTwins& twins, int failing_rank, const MakeFailing& make_failing) {
  std::string failure;
  MpiDelta delta;
  if (world_rank() == failing_rank) {
    const auto failing = make_failing();
    failure = error_of([&] { delta = twins.tested().update(); });
  } else {
    failure = error_of([&] { delta = twins.tested().update(); });
  }
  int failures = failure.empty() ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &failures, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
  if (failures == 0) {
    twins.compare(delta);
    return false;
  }
  EXPECT_EQ(failures, world_size()) << "all ranks must report it";
  EXPECT_THAT(failure, StartsWith("rank " + std::to_string(failing_rank) + ": "));
  return true;
}

void exhaust_memory(bool in_place) {
  constexpr long most = 2000;
  const long step = algorithm_under_test == "sweep-and-prune" ? 1 : 37;
  int failures = 0;
  int successes = 0;  // in a row, because the ranks have different numbers of points
  for (long first = 0; first < most && successes < world_size() && !has_failed(); first += step) {
    SCOPED_TRACE(std::to_string(first) + (in_place ? ", in place" : ""));
    MpiTwins twins(config());
    Dice dice(7);
    const auto change = [&](int calls) {
      if (in_place) {
        map_all(twins, dice);
      } else {
        for (int call = 0; call < calls; ++call) do_anything(twins, dice, true);
      }
    };
    change(60);
    twins.update();
    change(40);
    const auto make_failing = [&] { return FailingAllocations(first, 1); };
    if (!update_in_trouble(twins, static_cast<int>(first) % world_size(), make_failing)) {
      ++successes;
      continue;
    }
    successes = 0;
    ++failures;
    if (first % 2 == 0) twins.compare_pairs();
    if (first % 3 != 0) change(5);
    twins.update();
    twins.compare_pairs();
  }
  EXPECT_GE(failures, 2);
}

TEST(Mpi, WhereverMemoryIsExhaustedTheCallMayBeRepeated) {
  exhaust_memory(false);
  exhaust_memory(true);
}

/// For one call, and for all until the next update.
TEST(Mpi, ADeviceThatFailsOnOneRankLosesNothingOnAny) {
  if (algorithm_under_test == "sweep-and-prune") return;
  MpiTwins twins(config());
  Dice dice(8);
  int failures = 0;
  for (int first = 0; first < 60 && !has_failed(); ++first) {
    SCOPED_TRACE(first);
    if (first % 3 == 0) {
      for (int call = 0; call < 20; ++call) do_anything(twins, dice, true);
    } else {
      map_all(twins, dice);
      twins.update();
      map_all(twins, dice);
    }
    const auto make_failing = [&] { return FailingOpenCl(first % 30, first < 30 ? 1 : 1000); };
    if (!update_in_trouble(twins, first % world_size(), make_failing)) continue;
    ++failures;
    if (first % 2 == 0) twins.compare_pairs();
    if (first % 5 == 0) map_all(twins, dice);
    twins.update();
  }
  twins.compare_pairs();
  EXPECT_GT(failures, 20);
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
