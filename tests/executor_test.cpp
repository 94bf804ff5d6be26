// Loops in threads of the application. This file is also in the program for ThreadSanitizer.
#include <array>
#include <atomic>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "base/parallel.hpp"
#include "patience.hpp"
#include "runs.hpp"
#include "shared_work.hpp"

namespace broadcl::test {
namespace {

using Task = std::function<void()>;

/// Threads that run tasks, until they are destroyed.
class Workers {
 public:
  explicit Workers(std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) threads_.emplace_back([this] { work(); });
  }
  ~Workers() {
    ends_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  Workers(Workers&&) = delete;
  Workers& operator=(Workers&&) = delete;

  void run(Task task) {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }

 private:
  void work() {
    while (true) {
      const bool ends = ends_;
      if (const Task task = next()) {
        task();
      } else if (ends) {
        return;
      } else {
        std::this_thread::yield();
      }
    }
  }
  Task next() {
    const std::lock_guard lock(mutex_);
    if (tasks_.empty()) return {};
    Task task = std::move(tasks_.back());
    tasks_.pop_back();
    return task;
  }

  std::mutex mutex_;
  std::vector<Task> tasks_;
  std::atomic<bool> ends_ = false;
  std::vector<std::thread> threads_;
};

/// Whatever the application does with a task, results are the same.
template <class Box>
void expect_same_results(const Executor& executor) {
  static const std::vector<Numbers> expected =
      shared_work<Box>({.algorithm = "sweep-and-prune", .threads = 1});
  EXPECT_GT(expected.front().size(), 10'000U);
  std::atomic<std::size_t> given = 0;
  const Executor counted = [&](Task task) {
    ++given;
    executor(std::move(task));
  };
  const auto after = [&](const std::string& call) {
    if (!call.empty()) {
      EXPECT_GT(given.exchange(0), 0U) << call;
    }
  };
  EXPECT_EQ(shared_work<Box>({.algorithm = "sweep-and-prune", .threads = 3, .executor = counted}, after),
            expected);
}

void expect_same_results(const Executor& executor) {
  expect_same_results<Aabb>(executor);
  expect_same_results<Aabb64>(executor);
}

NOT_IN(sanitizers, "ThreadSanitizer sees it");
TEST(Executor, RunsTasksInOtherThreads) {
  Workers workers(2);
  expect_same_results([&](const Task& task) { workers.run(task); });
}

TEST(Executor, MayRunTasksInTheCallingThread) {
  expect_same_results([](const Task& task) { task(); });
}

TEST(Executor, MayRunATaskTwice) {
  Workers workers(3);
  expect_same_results<Aabb>([&](const Task& task) {
    workers.run(task);
    workers.run(task);
    task();
  });
}

TEST(Executor, MayLeaveTasksOut) {
  expect_same_results<Aabb>([](const Task& /*task*/) {});
}

TEST(Executor, MayThrow) {
  expect_same_results<Aabb>([](const Task& /*task*/) { throw 1; });
}

TEST(Executor, MayRunTasksWhenTheirObjectsAreGone) {
  std::vector<Task> late;
  expect_same_results<Aabb>([&](const Task& task) { late.push_back(task); });
  EXPECT_GT(late.size(), 0U);
  for (const Task& task : late) task();
}

/// Both callers have all of their helpers at the same time, and loops within loops.
TEST(Executor, TakesPartInNestedLoops) {
  Workers workers(3);
  const Threads threads(Config{.threads = 4, .executor = [&](const Task& task) { workers.run(task); }});
  for (int round = 0; round < 20; ++round) {
    std::atomic<std::size_t> calls = 0;
    std::array<std::atomic<bool>, 4> are_there{};
    parallel_for(4, threads, [&](std::size_t k, std::size_t /*thread*/) {
      are_there.at(k) = true;
      // The outer calls wait for each other, so each is in a thread of its own.
      EXPECT_TRUE(eventually([&] {
        return std::ranges::all_of(are_there,
                                   [](const std::atomic<bool>& is_there) { return is_there.load(); });
      }));
      parallel_for(50, threads, [&](std::size_t /*k*/, std::size_t thread) {
        EXPECT_LT(thread, 4U);
        ++calls;
      });
    });
    EXPECT_EQ(calls, 200U);
  }
}

TEST(Executor, ServesQueriesOfManyThreads) {
  Workers workers(2);
  BroadPhase broad_phase({.algorithm = "sweep-and-prune", .threads = 3, .executor = [&](const Task& task) {
                            workers.run(task);
                          }});
  const std::vector<Aabb> boxes = many_boxes<Aabb>(1);
  broad_phase.add(boxes);
  const Numbers expected = overlapping(boxes, boxes, {}, {.threads = 1}).ids;
  std::vector<std::thread> callers;
  callers.reserve(4);
  for (int k = 0; k < 4; ++k) {
    callers.emplace_back([&] { EXPECT_EQ(broad_phase.overlapping(boxes).ids, expected); });
  }
  for (std::thread& caller : callers) caller.join();
}

}  // namespace
}  // namespace broadcl::test
