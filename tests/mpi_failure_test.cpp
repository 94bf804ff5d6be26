#include <broadcl/mpi.hpp>

#include <mpi.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "boxes.hpp"
#include "expect_error.hpp"
#include "failing_allocations.hpp"
#include "failing_opencl.hpp"
#include "mpi_player.hpp"
#include "mpi_twins.hpp"

/// What fails on one rank fails on all, and changes nothing on any.
namespace broadcl::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

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

#ifdef BROADCL_MPI_ON_DEVICE
TEST(Mpi, BoxesThatOneRankCannotGiveAreRefusedOnAll) {
  const CallersQueue queue;
  const cl::Buffer buffer = queue.buffer_of(std::vector<Aabb>(2, unit));
  MpiDeviceBroadPhase tested(MPI_COMM_WORLD, queue());
  const DeviceBroadPhase::Boxes good{.buffer = buffer(), .count = 2};
  const auto expect_error = [&](const DeviceBroadPhase::Boxes& bad, const std::string& what) {
    const bool is_bad = world_rank() == world_size() - 1;
    EXPECT_THAT(error_of([&] { (void)tested.update(is_bad ? bad : good); }),
                AllOf(StartsWith("rank " + std::to_string(world_size() - 1) + ": "), HasSubstr(what)));
  };
  expect_error({.buffer = nullptr, .count = 2}, "the buffer of boxes is null");
  expect_error({.buffer = buffer(), .count = 3}, "too few for 3");
  expect_error({.buffer = buffer(), .count = 2, .ordered_worlds = 1}, "sorted by world");
  expect_error({.buffer = buffer(), .count = 1, .second = {.buffer = buffer(), .count = 1}}, "two sets");
  EXPECT_EQ(tested.update(good).own.added.count, 1U);
}
#endif

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
  twins.prepare();
  decltype(twins.tested().update()) delta;
  const auto update = [&] {
    try {
      delta = twins.tested().update();
    } catch (const Error& error) {
      failure = error.what();
    }
  };
  if (world_rank() == failing_rank) {
    const auto failing = make_failing();
    update();
  } else {
    update();
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

/// A script of up to 60 objects with filters, always the same.
CoreScript script_of_filters() {
  CoreScript script = core_scripts(ScriptSize::small)(rc::Random(17), 0).value();
  script.most = 60;
  script.filters = FilterKind::all;
  return script;
}

/// The changes of objects in a script.
class Changes {
 public:
  explicit Changes(const CoreScript& script) : ops_(script.ops), player_(script) {}

  [[nodiscard]] MpiTwins& twins() { return player_.twins(); }

  void of_objects(std::size_t ops) {
    for (; ops > 0; --ops) player_.change(next());
  }
  /// The boxes of all objects of each rank, in place if nothing else changed.
  void of_all_boxes() {
    CoreOp op = next();
    op.count = 20;
    op.filter = 1;
    for (int rank = 0; rank < world_size(); ++rank) player_.map(rank, op);
  }

 private:
  const CoreOp& next() { return ops_[next_++ % ops_.size()]; }

  const std::vector<CoreOp>& ops_;
  std::size_t next_ = 0;
  MpiPlayer player_;
};

void exhaust_memory(bool in_place) {
  constexpr long most = 2000;
  const long step = algorithm_under_test == "sweep-and-prune" ? 1 : 37;
  const CoreScript script = script_of_filters();
  int failures = 0;
  int successes = 0;  // in a row, because the ranks have different numbers of points
  for (long first = 0; first < most && successes < world_size() && !has_failed(); first += step) {
    SCOPED_TRACE(std::to_string(first) + (in_place ? ", in place" : ""));
    Changes changes(script);
    const auto change = [&](std::size_t ops) { in_place ? changes.of_all_boxes() : changes.of_objects(ops); };
    change(60);
    changes.twins().update();
    change(40);
    const auto make_failing = [&] { return FailingAllocations(first, 1); };
    if (!update_in_trouble(changes.twins(), static_cast<int>(first) % world_size(), make_failing)) {
      ++successes;
      continue;
    }
    successes = 0;
    ++failures;
    if (first % 2 == 0) changes.twins().compare_pairs();
    if (first % 3 != 0) change(5);
    changes.twins().update();
    changes.twins().compare_pairs();
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
  const CoreScript script = script_of_filters();
  Changes changes(script);
  MpiTwins& twins = changes.twins();
  int failures = 0;
  for (int first = 0; first < 60 && !has_failed(); ++first) {
    SCOPED_TRACE(first);
    if (first % 3 == 0) {
      changes.of_objects(20);
    } else {
      changes.of_all_boxes();
      twins.update();
      changes.of_all_boxes();
    }
    const auto make_failing = [&] { return FailingOpenCl(first % 30, first < 30 ? 1 : 1000); };
    if (!update_in_trouble(twins, first % world_size(), make_failing)) continue;
    ++failures;
    if (first % 2 == 0) twins.compare_pairs();
    if (first % 5 == 0) changes.of_all_boxes();
    twins.update();
  }
  twins.compare_pairs();
  EXPECT_GT(failures, 20);
}

}  // namespace
}  // namespace broadcl::test
