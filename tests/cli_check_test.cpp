// `broadcl check`, run as users run it, and its report on wrong kernels.
#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <regex>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <broadcl/version.h>
#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>

#include "program.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

SUITE_NOT_IN(ProgramWrongKernels, sanitizers, "compiles all kernels anew");

using nlohmann::json;

NOT_IN(all_default | sanitizers, "takes long");
TEST_F(Program, CheckWorksHere) {
  const Outcome outcome = run("check --device " + select_device().id() + " --report report.json");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with(select_device().label())) << outcome.out;
  EXPECT_EQ(lines_of(outcome.out).back(), "BroadCL works here.");
  std::size_t end_of_host = 0;
  std::size_t begin_of_device = std::string::npos;
  for (const AlgorithmInfo& algorithm : algorithms()) {
    const std::size_t row = outcome.out.find("\n  " + std::string(algorithm.name) + " ");
    EXPECT_NE(row, std::string::npos) << outcome.out;
    if (algorithm.on_device) {
      begin_of_device = std::min(begin_of_device, row);
    } else {
      end_of_host = std::max(end_of_host, row);
    }
  }
  EXPECT_LT(end_of_host, begin_of_device) << "what needs no compiler comes first\n" << outcome.out;

  const json report = json::parse(read_file(path("report.json")));
  EXPECT_EQ(report["versions"]["broadcl"], BROADCL_VERSION_STRING);
  EXPECT_NE(report["system"], "");
  EXPECT_EQ(report["device"]["name"], select_device().name);
  EXPECT_EQ(report["device"]["driver_version"], select_device().driver_version);
  EXPECT_FALSE(report.contains("why_no_device"));
  EXPECT_EQ(report["algorithms"].size(), algorithms().size());
  for (const json& algorithm : report["algorithms"]) {
    EXPECT_NE(outcome.out.find("\n  " + algorithm["name"].get<std::string>() + " "), std::string::npos);
    EXPECT_EQ(algorithm["result"], "right");
    for (const char* part : {"open", "scenes", "frames"}) EXPECT_GT(algorithm["milliseconds"][part], 0);
  }
}

NOT_IN(sanitizers, "takes long");
TEST_F(Program, CheckNeedsNoDevice) {
  const Outcome outcome = run("check --report report.json", "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent");
  expect_success(outcome);
  if (!outcome.out.starts_with(
          "Only the algorithms of the host are checked: no OpenCL device found; install")) {
    GTEST_SKIP() << "this OpenCL loader ignores OCL_ICD_VENDORS, so devices cannot be hidden";
  }
  for (const AlgorithmInfo& algorithm : algorithms()) {
    const bool is_checked = outcome.out.find("\n  " + std::string(algorithm.name) + " ") != std::string::npos;
    EXPECT_EQ(is_checked, !algorithm.on_device || algorithm.name == "auto") << algorithm.name << '\n'
                                                                            << outcome.out;
  }
  EXPECT_EQ(lines_of(outcome.out).back(), "BroadCL works here.");
  const json report = json::parse(read_file(path("report.json")));
  EXPECT_EQ(report["device"], nullptr);
  EXPECT_TRUE(report["why_no_device"].get<std::string>().starts_with("no OpenCL device found"));
}

NOT_IN(sanitizers, "takes long");
TEST_F(Program, ChecksARecording) {
  expect_success(run("simulate --objects 40 --frames 5 --broadphase sweep-and-prune", "BROADCL_RECORD=run"));
  const Outcome outcome = run("check run --report report.json", "BROADCL_RECORD=run");
  expect_success(outcome);
  const json report = json::parse(read_file(path("report.json")));
  EXPECT_EQ(report["recording"], "run");
  EXPECT_EQ(report["algorithms"].size(), algorithms().size());
  EXPECT_NE(outcome.out.find("\n  gpu-bf          right in 5 frames of the recording\n"), std::string::npos)
      << outcome.out;
  expect_refused(run("check four.npy"), "(frames, n, 6)");
  fs::resize_file(path("run"), fs::file_size(path("run")) - 1);
  EXPECT_NE(run("check run").out.find("\nThe recording ends within frame 4, which is left out"),
            std::string::npos);
}

/// Kernels that find pairs that do not exist.
class ProgramWrongKernels : public Program {
 protected:
  ProgramWrongKernels() {
    fs::copy(BROADCL_KERNEL_FOLDER, path("kernels"));
    std::string header = read_file(path("kernels/aabb.h"));
    const std::string condition = "test(s_lower_x, t_upper_x)";
    header.replace(header.find(condition), condition.size(), "((s_lower_x) == (s_lower_x))");
    write_file(path("kernels/aabb.h"), header);
  }
  const std::string environment_ = "BROADCL_KERNEL_DIR=kernels BROADCL_CACHE_DIR=cache";
};

TEST_F(ProgramWrongKernels, CheckSaysThatItDoesNotWork) {
  const Outcome outcome = run("check --report report.json", environment_);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(lines_of(outcome.out).back(), "BroadCL does not work here.");
  EXPECT_TRUE(std::regex_search(outcome.out, std::regex("\n  gpu-bf +WRONG: scene '.*extra, the first \\(")))
      << outcome.out;
  EXPECT_TRUE(std::regex_search(outcome.out, std::regex("\n  oracle +right in "))) << outcome.out;
  for (const json& algorithm : json::parse(read_file(path("report.json")))["algorithms"]) {
    const std::string result = algorithm["result"];
    EXPECT_NE(outcome.out.find(" " + result), std::string::npos) << result << '\n' << outcome.out;
    EXPECT_TRUE(algorithm["name"] != "gpu-bf" || result.starts_with("scene '")) << result;
  }
}

TEST_F(ProgramWrongKernels, SimulateNamesTheFirstWrongFrame) {
  const Outcome outcome =
      run("simulate --broadphase gpu-bf --objects 40 --frames 3 --verify --json run.json", environment_);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  EXPECT_NE(outcome.out.find("\nverified      WRONG, first in frame 0; "), std::string::npos) << outcome.out;
  const json verdict = json::parse(read_file(path("run.json")))["verify"];
  EXPECT_EQ(verdict["equal"], false);
  EXPECT_EQ(verdict["first_wrong_frame"], 0);
  EXPECT_EQ(verdict["missing_pairs"], 0);
  EXPECT_GT(verdict["extra_pairs"], 0);
}

TEST_F(ProgramWrongKernels, ReplayNamesTheFirstWrongFrame) {
  expect_success(run("simulate --broadphase bullet-bf --objects 40 --frames 3 --record run.npy"));
  const Outcome outcome = run("replay run.npy --broadphase gpu-bf --verify --json run.json", environment_);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  EXPECT_NE(outcome.out.find("\nverified      WRONG, first in frame 0; "), std::string::npos) << outcome.out;
  EXPECT_EQ(json::parse(read_file(path("run.json")))["verify"]["first_wrong_frame"], 0);
}

}  // namespace
}  // namespace broadcl::test
