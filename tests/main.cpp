// All tests, or with --run=NAME those that state that they belong to a run (runs.hpp).
#include <algorithm>
#include <array>
#include <cstddef>
#include <exception>
#include <iostream>
#include <map>
#include <ostream>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "runs.hpp"

namespace broadcl::test {
namespace {

struct Run {
  std::string_view name;
  Runs bit;
};
constexpr std::array all_runs{Run{"gpu-profile", runs::gpu_profile},
                              Run{"rusticl", runs::rusticl},
                              Run{"oclgrind", runs::oclgrind},
                              Run{"oclgrind-gpu-profile", runs::oclgrind_gpu_profile},
                              Run{"oclgrind-bullet", runs::oclgrind_bullet},
                              Run{"sanitizers", runs::sanitizers}};

std::vector<const testing::TestInfo*> all_tests() {
  std::vector<const testing::TestInfo*> tests;
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  for (int s = 0; s < program.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *program.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t) tests.push_back(suite.GetTestInfo(t));
  }
  return tests;
}

/// The suite as the source has it: without the name of an instance, or the number of a type.
std::string suite_of(const testing::TestInfo& test) {
  const std::string name = test.test_suite_name();
  if (test.type_param() != nullptr) return name.substr(0, name.find('/'));
  const std::size_t slash = name.find('/');
  return slash == std::string::npos ? name : name.substr(slash + 1);
}

/// Runs that a test leaves out because of its parameter.
Runs left_out_for_parameter(std::string_view parameter) {
  // Bullet's own broad phases, which our contract is checked against.
  for (const std::string_view control : {"Tree", "Sweep", "Simple"}) {
    if (parameter == control) return ~0U;
  }
  for (const AlgorithmInfo& algorithm : algorithms()) {
    std::string name(algorithm.name);
    std::replace(name.begin(), name.end(), '-', '_');
    if (parameter != name) continue;
    if (name == "auto") return ~0U;  // asks the other algorithms
    return algorithm.on_device ? 0 : ~runs::sanitizers;
  }
  return 0;
}

/// The runs of each test.
std::map<const testing::TestInfo*, Runs> runs_of_tests() {
  const std::vector<const testing::TestInfo*> tests = all_tests();
  std::map<const testing::TestInfo*, RunStatement> of_suite;
  std::map<const testing::TestInfo*, RunStatement> of_test;
  for (const RunStatement& statement : run_statements()) {
    // The test that a statement is about begins in one of the next lines.
    const auto is_meant = [&](const testing::TestInfo* test) {
      if (!statement.suite.empty()) return suite_of(*test) == statement.suite;
      const int distance = test->line() - statement.line;
      return statement.file == test->file() && 0 < distance && distance <= 3;
    };
    bool found = false;
    for (const testing::TestInfo* test : tests) {
      if (!is_meant(test)) continue;
      found = true;
      RunStatement& all = (statement.suite.empty() ? of_test : of_suite)[test];
      all.also |= statement.also;
      all.never |= statement.never;
    }
    if (!found) {
      throw std::runtime_error(statement.file + ":" + std::to_string(statement.line) +
                               ": this statement about runs is followed by no test, or names no suite");
    }
  }
  std::map<const testing::TestInfo*, Runs> result;
  for (const testing::TestInfo* test : tests) {
    Runs runs = runs::sanitizers;
    for (const RunStatement& all : {of_suite[test], of_test[test]}) runs = (runs | all.also) & ~all.never;
    const std::string_view name = test->name();
    const std::size_t slash = name.rfind('/');
    if (slash != std::string_view::npos) runs &= ~left_out_for_parameter(name.substr(slash + 1));
    if (std::string_view(test->test_suite_name()).starts_with("Long")) runs = 0;
    result[test] = runs;
  }
  return result;
}

/// Selects the tests of a run.
void select(std::string_view name, const std::map<const testing::TestInfo*, Runs>& runs) {
  const auto* run =
      std::find_if(all_runs.begin(), all_runs.end(), [&](const Run& known) { return known.name == name; });
  if (run == all_runs.end()) {
    std::string names;
    for (const Run& known : all_runs) names.append(" ").append(known.name);
    throw std::runtime_error("no run is named '" + std::string(name) + "'; there is:" + names);
  }
  std::string filter;
  for (const auto& [test, runs_of_test] : runs) {
    if ((runs_of_test & run->bit) != 0)
      filter.append(test->test_suite_name()).append(".").append(test->name()).append(":");
  }
  if (filter.empty()) throw std::runtime_error("no test belongs to the run '" + std::string(name) + "'");
  GTEST_FLAG_SET(filter, filter);
  GTEST_FLAG_SET(brief, true);  // the usual output begins with the whole filter
}

/// Names each test that starts, which the brief output does not.
class TestNames : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo& test) override {
    std::cout << test.test_suite_name() << '.' << test.name() << std::endl;
  }
};

int run(int argc, char** argv) {
  const std::map<const testing::TestInfo*, Runs> runs = runs_of_tests();
  const std::string_view argument = argc > 1 ? argv[1] : "";
  constexpr std::string_view option = "--run=";
  if (argc > 2 || (argc == 2 && !argument.starts_with(option)))
    throw std::runtime_error("unknown argument " + std::string(argument));
  if (argc == 2) {
    select(argument.substr(option.size()), runs);
    testing::UnitTest::GetInstance()->listeners().Append(new TestNames);
  }
  const int result = RUN_ALL_TESTS();
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  if (program.test_to_run_count() == 0) throw std::runtime_error("no test is selected");
  if (argc == 2 && program.skipped_test_count() > 0)
    throw std::runtime_error("a test that is skipped here must state that it is not in this run");
  return result;
}

}  // namespace
}  // namespace broadcl::test

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  try {
    return broadcl::test::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "broadcl_tests: " << error.what() << '\n';
    return 1;
  }
}
