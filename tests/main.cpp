// All tests, or with --run=NAME those that belong to this run (runs.hpp).
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "assertions.hpp"
#include "device_limits.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

constexpr std::string_view option = "--run=";

struct Run {
  std::string_view name;
  Runs any_of;
};
constexpr std::array all_runs{Run{"kernels", runs::kernels},
                              Run{"default", runs::all_default},
                              Run{"gpu-profile", runs::gpu_profile},
                              Run{"rusticl", runs::rusticl},
                              Run{"oclgrind", runs::oclgrind},
                              Run{"oclgrind-gpu-profile", runs::oclgrind_gpu_profile},
                              Run{"oclgrind-all", runs::oclgrind | runs::oclgrind_gpu_profile},
                              Run{"sanitizers", runs::sanitizers},
                              Run{"intel", runs::intel | runs::gpu_profile | runs::rusticl}};

/// A test and the runs that it belongs to.
struct Test {
  const testing::TestInfo* info;
  Runs runs;
};

/// The name of the suite in the source: without the name of an instance, or the number of a type.
std::string suite_of(const testing::TestInfo& test) {
  const std::string name = test.test_suite_name();
  if (test.type_param() != nullptr) return name.substr(0, name.find('/'));
  const std::size_t slash = name.find('/');
  return slash == std::string::npos ? name : name.substr(slash + 1);
}

/// Runs that a test is not in because of its parameter.
Runs left_out_for_parameter(std::string_view parameter) {
  constexpr Runs others = ~(runs::all_default | runs::kernels);
  // Bullet's own broad phases, with which our contract is checked: no change of ours changes them.
  for (const std::string_view control : {"Tree", "Sweep", "Simple"}) {
    if (parameter == control) return ~Runs{0};
  }
  for (const AlgorithmInfo& algorithm : algorithms()) {
    if (parameter != test_name(algorithm.name)) continue;
    if (algorithm.name == "auto") return others;  // uses the other algorithms
    return algorithm.on_device ? 0 : others & ~runs::sanitizers;
  }
  return 0;
}

/// Whether a statement belongs to a test: it names the test's suite, or the test begins in the next lines.
bool is_about(const RunStatement& statement, const testing::TestInfo& test) {
  if (!statement.suite.empty()) return suite_of(test) == statement.suite;
  const int distance = test.line() - statement.line;
  return statement.file == test.file() && 0 < distance && distance <= 3;
}

Test with_runs(const testing::TestInfo& test, std::vector<RunStatement>& unused) {
  Runs runs = runs::sanitizers | runs::all_default;
  for (const bool of_suite : {true, false}) {
    for (const RunStatement& statement : run_statements()) {
      if (statement.suite.empty() == of_suite || !is_about(statement, test)) continue;
      runs = (runs | statement.also) & ~statement.never;
      std::erase_if(unused, [&](const RunStatement& other) {
        return other.file == statement.file && other.line == statement.line;
      });
    }
  }
  const std::string_view name = test.name();
  const std::size_t slash = name.rfind('/');
  if (slash != std::string_view::npos) runs &= ~left_out_for_parameter(name.substr(slash + 1));
  if (std::string_view(test.test_suite_name()).starts_with("Long")) runs = 0;
  // Those of the run `kernels` are default tests that the run `default` leaves out.
  const bool is_default = (runs & runs::all_default) != 0;
  if ((runs & runs::kernels) != 0) runs &= is_default ? ~runs::all_default : ~runs::kernels;
  return {.info = &test, .runs = runs};
}

std::vector<Test> all_tests() {
  std::vector<Test> tests;
  std::vector<RunStatement> unused = run_statements();
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  for (int s = 0; s < program.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *program.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t)
      tests.push_back(with_runs(*suite.GetTestInfo(t), unused));
  }
  if (!unused.empty()) {
    throw std::runtime_error(unused.front().file + ":" + std::to_string(unused.front().line) +
                             ": this statement about runs is followed by no test, or names no suite");
  }
  return tests;
}

/// The filter of gtest that selects the tests of a run.
std::string filter_of(std::string_view name, const std::vector<Test>& tests) {
  std::string names;
  for (const Run& run : all_runs) {
    names.append(" ").append(run.name);
    if (run.name != name) continue;
    std::string filter;
    for (const Test& test : tests) {
      if ((test.runs & run.any_of) != 0)
        filter.append(test.info->test_suite_name()).append(".").append(test.info->name()).append(":");
    }
    if (filter.empty()) throw std::runtime_error("no test belongs to the run '" + std::string(name) + "'");
    return filter;
  }
  throw std::runtime_error("no run is named '" + std::string(name) + "'; there is:" + names);
}

/// Names each test that starts, unlike the brief output.
class TestNames : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo& test) override {
    std::cout << test.test_suite_name() << '.' << test.name() << std::endl;
  }
};

/// Fails a test that ends without an assertion, and does not say why it is not run (Contract::unfit()).
class Assertions : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo& /*test*/) override { before_ = assertions; }
  void OnTestEnd(const testing::TestInfo& test) override {
    const testing::TestResult& result = *test.result();
    bool says_why = false;
    for (int k = 0; k < result.test_property_count(); ++k)
      says_why |= std::string_view(result.GetTestProperty(k).key()) == "not_run";
    if (assertions == before_ && result.Passed() && !says_why)
      ADD_FAILURE() << "this test has evaluated no assertion";
  }

  unsigned long before_ = 0;
};

int run(int argc, char** argv) {
  const std::vector<Test> tests = all_tests();
  const std::string_view argument = argc > 1 ? argv[1] : "";
  if (argc > 2 || (argc == 2 && !argument.starts_with(option)))
    throw std::runtime_error("unknown argument " + std::string(argument));
  if (argc == 2) {
    GTEST_FLAG_SET(filter, filter_of(argument.substr(option.size()), tests));
    testing::UnitTest::GetInstance()->listeners().Append(new TestNames);
  }
  // The least that GPUs have.
  std::optional<LimitedDevices> limited;
  if (argument == "--run=gpu-profile") limited.emplace(Limits{.work_group = 256, .local_memory = 32 << 10});
  testing::UnitTest::GetInstance()->listeners().Append(new Assertions);
  const int result = RUN_ALL_TESTS();
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  if (program.test_to_run_count() == 0) throw std::runtime_error("no test is selected");
  // (A second device may be missing on a developer's machine, real boxes everywhere.)
  const bool has_real_boxes = std::getenv("BROADCL_TEST_DATA") != nullptr;  // NOLINT(concurrency-mt-unsafe)
  const bool is_any_skipped = std::ranges::any_of(tests, [&](const Test& test) {
    const bool is_of_real_boxes = std::string_view(test.info->name()).starts_with("RealBoxes");
    return test.info->result()->Skipped() && (has_real_boxes || !is_of_real_boxes);
  });
  const bool may_skip = (argument == "--run=default" || argument == "--run=kernels") &&
                        std::getenv("BROADCL_NO_SKIPS") == nullptr;  // NOLINT(concurrency-mt-unsafe)
  if (argc == 2 && !may_skip && is_any_skipped)
    throw std::runtime_error("a test was skipped; it must state that it is not in this run");
  return result;
}

}  // namespace
}  // namespace broadcl::test

int main(int argc, char** argv) {
  // The usual output begins with the whole filter.
  if (argc > 1 && std::string_view(argv[1]).starts_with(broadcl::test::option)) GTEST_FLAG_SET(brief, true);
  testing::InitGoogleMock(&argc, argv);
  try {
    return broadcl::test::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "broadcl_tests: " << error.what() << '\n';
    return 1;
  }
}
