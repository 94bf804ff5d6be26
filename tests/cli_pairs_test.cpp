// `broadcl pairs`, run as users run it.
#include <algorithm>
#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "npy_bytes.hpp"
#include "program.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

TEST_F(Program, HostAlgorithmNeedsNoDevice) {
  const Outcome outcome = run("pairs four.npy --algorithm oracle", "OCL_ICD_VENDORS=/nonexistent");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (oracle on the host)")) << outcome.out;
}

TEST_F(Program, PairsAreFoundOnTheHostIfThereIsNoDevice) {
  const Outcome outcome = run("pairs four.npy", "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent");
  expect_success(outcome);
  if (run("devices", "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent").exit_code == 0) {
    GTEST_SKIP() << "this OpenCL loader ignores OCL_ICD_VENDORS, so devices cannot be hidden";
  }
  EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (auto on the host)\n")) << outcome.out;
}

NOT_IN(sanitizers, "starts many processes");
TEST_F(Program, SaysOnceThatItBuildsKernels) {
  const auto line_of = [&](const std::string& algorithm, const std::string& environment) {
    const Outcome outcome = run("pairs four.npy --algorithm " + algorithm, environment);
    expect_success(outcome);
    return outcome.compiling;
  };
  const std::string label = select_device().label();
  EXPECT_EQ(line_of("brute-force", "BROADCL_CACHE_DIR=new"),
            "compiling kernels for " + label + ", once; they are stored in 'new'\n");
  EXPECT_EQ(line_of("brute-force", "BROADCL_CACHE_DIR=new"), "");
  for (const std::string environment :
       {"BROADCL_CACHE_DIR= XDG_CACHE_HOME= HOME=", "BROADCL_CACHE_DIR= XDG_CACHE_HOME=relative HOME=",
        "BROADCL_CACHE_DIR=/dev/null", "BROADCL_CACHE_DIR=/proc/nowhere", "BROADCL_CACHE_DIR=four.npy"}) {
    EXPECT_EQ(line_of("brute-force", environment),
              "compiling kernels for " + label +
                  ", at each start because there is no cache folder that only you can write; "
                  "BROADCL_CACHE_DIR can name one\n");
  }
  EXPECT_EQ(line_of("sweep-and-prune", "BROADCL_CACHE_DIR=other"), "");
}

TEST_F(Program, PairsOfEveryAlgorithm) {
  for (const AlgorithmInfo& algorithm : algorithms()) {
    const Outcome outcome = run("pairs four.npy --out pairs.npy --algorithm " + std::string(algorithm.name));
    expect_success(outcome);
    EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (")) << outcome.out;
    const std::string written = read_file(path("pairs.npy"));
    EXPECT_EQ(written.substr(0, 6), "\x93NUMPY");
    EXPECT_NE(written.find("'descr': '<u4', 'fortran_order': False, 'shape': (2, 2)"), std::string::npos);
    EXPECT_EQ(written.substr(written.find('\n') + 1), std::string("\0\0\0\0\1\0\0\0\1\0\0\0\2\0\0\0", 16));
  }
}

/// 0.1 + 0.2 and 0.3 are one number in single precision.
TEST_F(Program, PairsOfDoublePrecisionAreExact) {
  const std::vector<double> numbers{0.1 + 0.2, 0, 0, 1, 1, 1, 0, 0, 0, 0.3, 1, 1};
  write_file(path("double.npy"),
             npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 6), }", bytes_of(numbers)));
  const Outcome outcome = run("pairs double.npy");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("0 overlapping pairs of 2 boxes")) << outcome.out;
}

TEST_F(Program, PairsOfNoBoxes) {
  write_file(path("none.npy"), npy({}));
  const Outcome outcome = run("pairs none.npy --out pairs.npy");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("0 overlapping pairs of 0 boxes")) << outcome.out;
  EXPECT_NE(read_file(path("pairs.npy")).find("'shape': (0, 2)"), std::string::npos);
}

TEST_F(Program, PairsSaysHowLongItTook) {
  const std::string number = R"(\d+\.\d{3} s)";
  const auto last_line = [&](const std::string& arguments) { return lines_of(run(arguments).out).back(); };
  EXPECT_TRUE(std::regex_match(last_line("pairs four.npy --algorithm oracle"),
                               std::regex("reading " + number + ", searching " + number)));
  const std::string line = last_line("pairs four.npy --algorithm brute-force --out pairs.npy");
  EXPECT_TRUE(std::regex_match(line, std::regex("reading " + number + ", searching " + number + ", writing " +
                                                number + "; searching includes opening the device")))
      << line;
}

TEST_F(Program, PairsWarnsOfInvertedBoxes) {
  const auto warning_of = [&](const std::vector<float>& boxes) {
    write_file(path("boxes.npy"), npy(boxes));
    const Outcome outcome = run("pairs boxes.npy");
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_EQ(lines_of(outcome.out).size(), 2U);
    return outcome.err;
  };
  const std::string begin = "broadcl: warning: inverted boxes (min > max), which overlap nothing: ";
  const std::string give = " Give min x, y, z, max x, y, z\n";
  std::vector<float> boxes = four_boxes;
  EXPECT_EQ(warning_of(boxes), "");
  const auto [lower, upper] = empty_aabb();
  std::ranges::copy(upper, std::ranges::copy(lower, boxes.begin()).out);
  EXPECT_EQ(warning_of(boxes), "");
  boxes[6] = 5;  // above its upper bound
  EXPECT_EQ(warning_of(boxes),
            begin +
                "1 of 4 rows, the first of them row 1; infinity > -infinity on each axis is a box that is "
                "meant to be empty\n");
  EXPECT_EQ(warning_of({0, 1, 0, 1, 0, 1, 5, 6, 1, 2, 1, 2}),
            begin + "2 of 2 rows, the first of them row 0; are the columns min x, max x, min y, ...?" + give);
  EXPECT_EQ(warning_of({5, 6, 7, 1, 1, 1, 8, 0, 7, 1, 1, 1}),
            begin + "2 of 2 rows, the first of them row 0; are the columns a centre and a size?" + give);
}

TEST_F(Program, CountsOneInTheSingular) {
  write_file(path("touching.npy"), npy({0, 0, 0, 1, 1, 1, 1, 0, 0, 2, 1, 1}));
  EXPECT_TRUE(run("pairs touching.npy").out.starts_with("1 overlapping pair of 2 boxes ("));
  write_file(path("one.npy"), npy({0, 0, 0, 1, 1, 1}));
  EXPECT_TRUE(run("pairs one.npy").out.starts_with("0 overlapping pairs of 1 box ("));
  const std::string out = run("simulate --objects 1 --frames 1 --broadphase bullet-bf").out;
  EXPECT_NE(out.find(", 1 cube, 1 frame, seed 1\n"), std::string::npos) << out;
}

TEST_F(Program, PairsReplacesAnOlderFileOnlyWhenItIsDone) {
  write_file(path("pairs.npy"), "old");
  EXPECT_EQ(run("pairs nan.npy --out pairs.npy").exit_code, 2);
  EXPECT_EQ(read_file(path("pairs.npy")), "old");
  expect_success(run("pairs four.npy --out pairs.npy"));
  EXPECT_NE(read_file(path("pairs.npy")), "old");
}

TEST_F(Program, PairsWritesThroughALinkAndToADevice) {
  write_file(path("target.npy"), "old");
  fs::create_symlink("target.npy", path("link.npy"));
  expect_success(run("pairs four.npy --out link.npy"));
  EXPECT_TRUE(fs::is_symlink(path("link.npy")));
  EXPECT_TRUE(read_file(path("target.npy")).starts_with("\x93NUMPY"));
  expect_success(run("pairs four.npy --out /dev/null"));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

}  // namespace
}  // namespace broadcl::test
