// `broadcl pairs`, run as its users do.
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "program.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

TEST_F(Program, HostAlgorithmNeedsNoDevice) {
  const Outcome outcome = run("pairs four.npy --algorithm oracle", "OCL_ICD_VENDORS=/nonexistent");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (oracle on the host)")) << outcome.out;
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

TEST_F(Program, PairsOfNoBoxes) {
  write_file(path("none.npy"), npy({}));
  const Outcome outcome = run("pairs none.npy --out pairs.npy");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("0 overlapping pairs of 0 boxes")) << outcome.out;
  EXPECT_NE(read_file(path("pairs.npy")).find("'shape': (0, 2)"), std::string::npos);
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

class ProgramRealData : public Program {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("BROADCL_TEST_DATA");
    if (folder == nullptr) GTEST_SKIP() << "BROADCL_TEST_DATA does not name the folder of the real boxes";
    data_ = folder;
  }
  /// The file as an argument.
  [[nodiscard]] std::string data(const std::string& name) const {
    return "'" + (data_ / name).string() + "'";
  }

 private:
  fs::path data_;
};

SUITE_NOT_IN(ProgramRealData, sanitizers, "takes long, and boxes may be missing");
TEST_F(ProgramRealData, ClothFunnelEdges) {
  const Outcome outcome = run("pairs " + data("cloth-funnel-edges.npy"));
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("172385 overlapping pairs of 27930 boxes (")) << outcome.out;
}

TEST_F(ProgramRealData, ClothFunnelFacesIsTheSameInEveryRunAndAlgorithm) {
  for (const std::string options :
       {"--out first.npy", "--out second.npy", "--out oracle.npy --algorithm oracle"}) {
    const Outcome outcome = run("pairs " + data("cloth-funnel-faces.npy") + " " + options);
    expect_success(outcome);
    EXPECT_TRUE(outcome.out.starts_with("153821 overlapping pairs of 18484 boxes (")) << outcome.out;
  }
  const std::string first = read_file(path("first.npy"));
  EXPECT_EQ(first.size(), 128 + 8 * 153'821U);
  EXPECT_TRUE(first == read_file(path("second.npy")));
  EXPECT_TRUE(first == read_file(path("oracle.npy")));
}

}  // namespace
}  // namespace broadcl::test
