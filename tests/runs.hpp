#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

/// Every test runs on the default device. Which other runs it belongs to is stated beside it:
///
///   SUITE_ALSO_IN(Scan, gpu_profile | rusticl);   all tests of a suite
///   ALSO_IN(oclgrind);                            the test that follows
///   NOT_IN(sanitizers, "takes a minute");         the test that follows; SUITE_NOT_IN for a suite
///
/// A statement about a test overrides the one about its suite. `broadcl_tests --run=NAME` (main.cpp) executes
/// a run, and lists its tests with --gtest_list_tests. A statement that applies to no test, and a run without
/// tests, are errors.
namespace broadcl::test {

using Runs = unsigned;

namespace runs {

/// On the default device, in fewer processes than tests, which takes half of the time. Every test is in it
/// unless it says otherwise.
inline constexpr Runs all_default = 128;
/// The same, before the others: tests of kernels tuned for GPUs, which PoCL compiles for minutes if its cache
/// is empty. They are not in all_default then.
inline constexpr Runs kernels = 256;
/// On the default device, with kernels tuned for GPUs.
inline constexpr Runs gpu_profile = 1;
/// On Mesa's rusticl.
inline constexpr Runs rusticl = 2;
/// Under Oclgrind, with kernels tuned for CPUs: a few work-items at a time.
inline constexpr Runs oclgrind = 4;
/// Under Oclgrind, with kernels tuned for GPUs: seconds per test.
inline constexpr Runs oclgrind_gpu_profile = 8;
/// Under AddressSanitizer and UndefinedBehaviorSanitizer, about ten times slower. Every test is in it unless
/// it says otherwise.
inline constexpr Runs sanitizers = 32;
/// On Intel's OpenCL for CPUs. Tests in the runs gpu_profile and rusticl are in it, too.
inline constexpr Runs intel = 64;

}  // namespace runs

/// A statement about the test that follows its line, or about a suite if that is named.
struct RunStatement {
  std::string file;
  int line;
  std::string suite;
  Runs also;
  Runs never;
};

/// All statements of the program.
inline std::vector<RunStatement>& run_statements() {
  static std::vector<RunStatement> statements;
  return statements;
}

inline std::size_t state_runs(RunStatement statement) {
  run_statements().push_back(std::move(statement));
  return run_statements().size();
}

}  // namespace broadcl::test

#define BROADCL_JOIN2(a, b) a##b
#define BROADCL_JOIN(a, b) BROADCL_JOIN2(a, b)
#define BROADCL_STATE_RUNS(suite, also, never)                                          \
  [[maybe_unused]] static const std::size_t BROADCL_JOIN(run_statement_, __COUNTER__) = \
      ::broadcl::test::state_runs([] {                                                  \
        using namespace ::broadcl::test::runs;                                          \
        return ::broadcl::test::RunStatement{__FILE__, __LINE__, suite, also, never};   \
      }())

#define ALSO_IN(runs) BROADCL_STATE_RUNS("", runs, 0)
#define NOT_IN(runs, why)                             \
  static_assert(sizeof("" why) > 1, "give a reason"); \
  BROADCL_STATE_RUNS("", 0, runs)
#define SUITE_ALSO_IN(suite, runs) BROADCL_STATE_RUNS(#suite, runs, 0)
#define SUITE_NOT_IN(suite, runs, why)                \
  static_assert(sizeof("" why) > 1, "give a reason"); \
  BROADCL_STATE_RUNS(#suite, 0, runs)
