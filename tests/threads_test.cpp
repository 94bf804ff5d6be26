// What may run in several threads at once. This file is also a program of its own for ThreadSanitizer.
#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <latch>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "base/thread_pool.hpp"
#include "bullet_rig.hpp"
#include "each_algorithm.hpp"
#include "environment.hpp"
#include "opencl/error.hpp"
#include "patience.hpp"
#include "query_rig.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

const Kind& broadcl_kind = kinds.front();

/// Calls a function with 0, 1, ..., each in its own thread; the threads start together, and all are waited
/// for.
template <class Function>
void in_threads(std::size_t count, const Function& function) {
  std::latch start(static_cast<std::ptrdiff_t>(count));
  std::vector<std::thread> threads;
  threads.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
    threads.emplace_back([&start, &function, k] {
      start.arrive_and_wait();
      function(k);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

using Answer = std::multiset<const void*>;

/// Rays and box queries, many of which hit something.
std::vector<Answer> ask(QueryRig& rig, unsigned seed) {
  Random random(seed);
  std::vector<Answer> answers;
  for (int k = 0; k < 30; ++k) {
    const btVector3 from = random.point(22);
    const btVector3 to = random.point(22);
    if (random.below(2) == 0) {
      answers.push_back(rig.rays(from, to));
    } else {
      answers.push_back(rig.boxes(from, from + btVector3(4, 4, 4)));
    }
  }
  return answers;
}

/// Moves, destroys and creates; the few rounds with many moves keep the queries from using a tree.
void change(QueryRig& rig, unsigned round) {
  Random random(round);
  const unsigned moves = round % 4 == 3 ? 400 : 5;
  for (unsigned k = 0; k < moves; ++k) {
    const btVector3 lower = random.point(20);
    rig.move(rig.proxies()[random.below(static_cast<unsigned>(rig.proxies().size()))], lower,
             lower + random.point(3));
  }
  btBroadphaseProxy* gone = rig.proxies()[random.below(static_cast<unsigned>(rig.proxies().size()))];
  void* client = gone->m_clientObject;
  rig.destroy(gone);
  const btVector3 lower = random.point(20);
  rig.create(lower, lower + random.point(3), 1, all_bits, client);
  if (round % 3 == 0) rig.calculate();
}

TEST(Threads, QueriesRightAfterChangesAnswerAsOneAfterTheOther) {
  QueryRig rig(broadcl_kind);
  QueryRig alone(broadcl_kind);
  std::size_t met = 0;
  for (unsigned round = 0; round < 40; ++round) {
    change(rig, round);
    change(alone, round);
    std::array<std::vector<Answer>, 4> answers;
    in_threads(answers.size(), [&](std::size_t k) { answers.at(k) = ask(rig, static_cast<unsigned>(k)); });
    for (std::size_t k = 0; k < answers.size(); ++k) {
      ASSERT_EQ(answers.at(k), ask(alone, static_cast<unsigned>(k))) << "round " << round << ", thread " << k;
      for (const Answer& answer : answers.at(k)) met += answer.size();
    }
  }
  EXPECT_GT(met, 1000U);
}

/// A loop is over when finish() returns, also if another caller has begun one since.
TEST(Threads, OfThePoolLeaveTheLoopOfACallerThatReturned) {
  struct Shared {
    std::atomic<int> running = 0, late = 0;
    std::atomic<bool> may_return = false, has_returned = false;
    std::optional<ParallelLoop> loop;

    void share(std::size_t helpers) {
      loop.emplace(helpers + 1, helpers + 1, [&](std::size_t /*k*/, std::size_t /*thread*/) {
        ++running;
        while (!may_return) std::this_thread::yield();
      });
      loop->finish();
      // In the same memory, for this thread alone, which makes no call.
      loop.emplace(1, 1, [&](std::size_t /*k*/, std::size_t /*thread*/) { ++late; });
      has_returned = true;
    }
    void end() {
      may_return = true;
      while (!has_returned) std::this_thread::yield();
    }
  };
  constexpr int threads = 16;
  Shared busy;  // all threads of the pool
  Shared first;
  Shared second;
  const auto share = [](Shared& own, std::size_t helpers) {
    return std::thread([&own, helpers] { own.share(helpers); });
  };
  std::array callers{share(busy, threads), std::thread(), std::thread(), std::thread()};
  ASSERT_TRUE(eventually([&] { return busy.running == threads + 1; }));
  callers[1] = share(first, 1);
  ASSERT_TRUE(eventually([&] { return first.running == 1; }));
  callers[2] = share(second, 1);
  ASSERT_TRUE(eventually([&] { return second.running == 1; }));
  first.end();
  second.end();
  busy.end();
  // They have looked for work when they do some.
  Shared last;
  callers[3] = share(last, threads);
  ASSERT_TRUE(eventually([&] { return last.running == threads + 1; }));
  last.end();
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(first.late, 0);
}

/// The pairs of each frame, from the creation of a broad phase to its destruction.
std::vector<std::vector<std::pair<int, int>>> life(unsigned seed) {
  Rig rig(broadcl_kind);
  Random random(seed);
  std::vector<std::vector<std::pair<int, int>>> frames;
  for (int frame = 0; frame < 10; ++frame) {
    for (int call = 0; call < 20; ++call) call_at_random(rig, random, 6);
    rig.calculate();
    frames.push_back(rig.ids());
  }
  return frames;
}

TEST(Threads, TwoOfBulletsBroadPhasesLiveSideBySide) {
  const std::array expected{life(0), life(1)};
  EXPECT_GT(expected[0].back().size(), 20U);
  EXPECT_NE(expected[0], expected[1]);
  for (int round = 0; round < 3; ++round) {
    std::array<std::vector<std::vector<std::pair<int, int>>>, 2> frames;
    in_threads(frames.size(), [&](std::size_t k) { frames.at(k) = life(static_cast<unsigned>(k)); });
    ASSERT_EQ(frames, expected) << "round " << round;
  }
}

/// The changes in each frame while boxes move through each other.
std::vector<std::vector<Pair>> walk(std::string_view algorithm, std::size_t stride) {
  BroadPhase broad_phase({.algorithm = std::string(algorithm)});
  std::vector<std::vector<Pair>> frames;
  for (std::size_t frame = 0; frame < 8; ++frame) {
    const std::span<Aabb> boxes = broad_phase.map(64);
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      const auto x = static_cast<float>((k + frame * k * stride) % 50);
      boxes[k] = {{x, 0, 0}, {x + 1, 1, 1}};
    }
    const Delta delta = broad_phase.update();
    frames.emplace_back(delta.added.begin(), delta.added.end());
    frames.emplace_back(delta.removed.begin(), delta.removed.end());
  }
  return frames;
}

NOT_IN(sanitizers, "compiles everything anew, and ThreadSanitizer sees it");
TEST(Threads, TwoBroadPhasesShareAFolderOfPrograms) {
  const std::array expected{walk("oracle", 1), walk("oracle", 2)};
  EXPECT_GT(expected[0].back().size(), 5U);
  for (const AlgorithmInfo& algorithm : algorithms()) {
    if (!device_for({.algorithm = std::string(algorithm.name)})) continue;  // or it opens a GPU later
    const ScopedFolder folder;
    const ScopedVariable variable("BROADCL_CACHE_DIR", folder.path().string());
    for (const std::string_view round : {"both compile", "both load"}) {
      opencl::forget_opened_devices();
      std::array<std::vector<std::vector<Pair>>, 2> frames;
      in_threads(frames.size(), [&](std::size_t k) { frames.at(k) = walk(algorithm.name, k + 1); });
      ASSERT_EQ(frames, expected) << algorithm.name << ", " << round;
    }
    std::size_t programs = 0;
    for (const std::filesystem::directory_entry& file : std::filesystem::directory_iterator(folder.path())) {
      EXPECT_EQ(file.path().extension(), ".bin") << file;
      ++programs;
    }
    EXPECT_GT(programs, 0U) << algorithm.name;
  }
}

/// With three threads and with one.
void expect_threads_agree(unsigned seed) {
  constexpr std::uint32_t n = 13'000;  // enough for three threads
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> coordinate(0, 1);
  std::vector<Aabb> boxes(n);
  BroadPhase alone({.algorithm = "sweep-and-prune", .threads = 1});
  BroadPhase together({.algorithm = "sweep-and-prune", .threads = 3});
  for (int frame = 0; frame < 2; ++frame) {
    for (Aabb& box : boxes) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lower[axis] = coordinate(random);
        box.upper[axis] = box.lower[axis] + 0.05F * coordinate(random);
      }
    }
    std::ranges::copy(boxes, alone.map(n).begin());
    std::ranges::copy(boxes, together.map(n).begin());
    const Delta expected = alone.update();
    ASSERT_GT(expected.added.size(), 100U);
    EXPECT_TRUE(same(together.update(), expected.added, expected.removed)) << frame;
  }
}

TEST(Threads, OfTheHostFindTheSamePairs) {
  expect_threads_agree(1);
  in_threads(4, [&](std::size_t k) { expect_threads_agree(static_cast<unsigned>(k)); });
}

TEST(Threads, FunctionsThatBelongToNoObjectRunSideBySide) {
  std::vector<Aabb> boxes;
  for (int k = 0; k < 100; ++k) {
    const auto x = static_cast<float>(k);
    boxes.push_back({{x, 0, 0}, {x + 1, 1, 1}});
  }
  const std::size_t count = devices().size();
  const std::string label = select_device().label();
  const std::vector<Pair> expected = overlapping_pairs(boxes, {}, {.algorithm = "oracle"});
  EXPECT_EQ(expected.size(), 99U);
  std::array<bool, 4> is_right{};
  in_threads(is_right.size(), [&](std::size_t k) {
    is_right.at(k) = devices().size() == count && select_device().label() == label &&
                     overlapping_pairs(boxes, {}, {.algorithm = "brute-force"}) == expected;
  });
  EXPECT_EQ(is_right, (std::array{true, true, true, true}));
}

}  // namespace
}  // namespace broadcl::test
