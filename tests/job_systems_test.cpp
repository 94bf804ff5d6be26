// Other libraries' threads as those of the application. A program of its own, in which nothing else starts
// threads.
#include <broadcl/broadcl.h>
#include <broadcl/broad_phase.hpp>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <iterator>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "shared_work.hpp"

namespace broadcl::test {
namespace {

std::ptrdiff_t threads_of_process() {
  const std::filesystem::directory_iterator threads("/proc/self/task");
  return std::distance(begin(threads), end(threads));
}

/// Of four, with that of the test.
constexpr std::ptrdiff_t threads_of_a_job_system = 3;

Config with(const Executor& executor) {
  return {.algorithm = "sweep-and-prune", .threads = 4, .executor = executor};
}

const std::vector<Numbers>& expected() {
  static const std::vector<Numbers> results =
      shared_work<Aabb>({.algorithm = "sweep-and-prune", .threads = 1});
  return results;
}

/// Of the same threads as the searches, some of which search at the same time.
template <class ForEach>
void expect_side_by_side(const Executor& executor, const ForEach& for_each) {
  std::vector<std::vector<Numbers>> results(6);
  for_each(results.size(), [&](std::size_t k) { results[k] = shared_work<Aabb>(with(executor)); });
  for (const std::vector<Numbers>& own : results) EXPECT_EQ(own, expected());
}

TEST(JobSystems, OneThreadIsEnough) {
  const std::ptrdiff_t before = threads_of_process();
  EXPECT_EQ(shared_work<Aabb>(with([](const auto& task) { task(); })), expected());
  EXPECT_EQ(threads_of_process(), before);
}

TEST(JobSystems, TbbRunsTheTasks) {
  const std::ptrdiff_t before = threads_of_process();
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  tbb::task_arena arena(4);
  const Executor executor = [&](std::function<void()> task) { arena.enqueue(std::move(task)); };
  EXPECT_EQ(shared_work<Aabb>(with(executor)), expected());
  expect_side_by_side(executor, [&](std::size_t count, const auto& function) {
    arena.execute([&] { tbb::parallel_for(std::size_t{0}, count, function); });
  });
  EXPECT_LE(threads_of_process(), before + threads_of_a_job_system);
}

TEST(JobSystems, OpenMPRunsTheTasks) {
  const std::ptrdiff_t before = threads_of_process();
  const Executor executor = [](const std::function<void()>& task) {
#pragma omp task firstprivate(task)
    task();
  };
  EXPECT_EQ(shared_work<Aabb>(with(executor)), expected());  // outside of a parallel region
#pragma omp parallel num_threads(4)
#pragma omp single
  EXPECT_EQ(shared_work<Aabb>(with(executor)), expected());
  expect_side_by_side(executor, [](std::size_t count, const auto& function) {
#pragma omp parallel for num_threads(4) schedule(dynamic)
    for (std::size_t k = 0; k < count; ++k) function(k);
  });
  EXPECT_LE(threads_of_process(), before + threads_of_a_job_system);
}

TEST(JobSystems, InCRunTheTasks) {
  const std::ptrdiff_t before = threads_of_process();
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  tbb::task_arena arena(4);
  broadcl_config config{};
  config.size = sizeof config;
  config.algorithm = "sweep-and-prune";
  config.threads = 4;
  config.executor = [](void (*run)(void*), void* task, void* data) {
    static_cast<tbb::task_arena*>(data)->enqueue([run, task] { run(task); });
  };
  config.executor_data = &arena;
  const std::vector<Aabb> boxes = many_boxes<Aabb>(1);
  broadcl_boxes given{};
  given.size = sizeof given;
  given.data = boxes.data();
  given.count = boxes.size();
  broadcl_pair_list* list = nullptr;
  ASSERT_EQ(broadcl_pair_list_create(&given, nullptr, nullptr, 0, &config, &list), BROADCL_SUCCESS);
  broadcl_pairs pairs{};
  ASSERT_EQ(broadcl_pair_list_pairs(list, &pairs), BROADCL_SUCCESS);
  EXPECT_EQ(2 * pairs.count, expected().front().size());
  EXPECT_EQ(broadcl_pair_list_destroy(list), BROADCL_SUCCESS);
  EXPECT_LE(threads_of_process(), before + threads_of_a_job_system);
}

TEST(JobSystems, WithoutThemTheLibraryStartsThreads) {
  const std::ptrdiff_t before = threads_of_process();
  EXPECT_EQ(shared_work<Aabb>(with({})), expected());
  EXPECT_GE(threads_of_process(), before + 3);
}

}  // namespace
}  // namespace broadcl::test
