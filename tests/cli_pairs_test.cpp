// `broadcl pairs`, run as users run it.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/error.hpp>

#include "cli/box_file.hpp"

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

TEST_F(Program, PairsOfTextAndOfStandardInput) {
  const std::string rows = "0,0,0,1,1,1\n1 0 0 2 1 1  # touches it\n\n2;0;0;3;1;1e0\r\n9,9,9,+10,inf,10";
  write_file(path("four.csv"), "lower x,y,z,upper x,y,z\n" + rows);
  write_file(path("four"), rows);
  write_file(path("flat.csv"), "0,0,1,1\n1,1,2,2\n3,3,4,4\n");
  write_file(path("exact.csv"), "0.30000000000000004,0,1,1\n0,0,0.3,1\n");
  for (const std::string file : {"four.csv", "four", "- < four.csv", "- < four.npy"}) {
    const Outcome outcome = run("pairs " + file);
    expect_success(outcome);
    EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (")) << file << outcome.out;
  }
  EXPECT_TRUE(run("pairs flat.csv").out.starts_with("1 overlapping pair of 3 boxes ("));
  EXPECT_TRUE(run("pairs exact.csv").out.starts_with("0 overlapping pairs of 2 boxes ("));
  write_file(path("flat.npy"), npy({0, 0, 1, 1, 1, 1, 2, 2, 3, 3, 4, 4}, 4));
  EXPECT_TRUE(run("pairs flat.npy").out.starts_with("1 overlapping pair of 3 boxes ("));
  const std::vector<std::pair<std::string, std::string>> bad_files = {
      {"0,0,1,1\nx\n", "line 2 has something other than numbers: x"},
      {"0,0,1,x\n0,0,1,1\n", "line 1 has something other than numbers: 0,0,1,x"},
      {"0,0,1\n", "line 1 has 3 numbers; 4 or 6 are needed"},
      {"0,0,1,1\n0,0,0,1,1,1\n", "line 2 has 6 numbers; the first box has 4"},
      {"0,0,1,nan\n", "line 1 has a NaN"}};
  for (const auto& [text, message] : bad_files) {
    write_file(path("bad.csv"), text);
    expect_refused(run("pairs bad.csv"), "cannot use 'bad.csv': " + message);
    expect_refused(run("pairs - < bad.csv"), "cannot use standard input: " + message);
  }
}

/// As numpy.savez writes it: sizes in 64 bits, nothing compressed.
TEST_F(Program, PairsOfAnArchive) {
  const auto member = [](const std::string& name, const std::string& data, std::uint64_t begin) {
    const std::string sizes =
        little_endian(0, 4) + little_endian(0xffffffff, 4) + little_endian(0xffffffff, 4);
    const std::string extra = little_endian(1, 2) + little_endian(16, 2) + little_endian(data.size(), 8) +
                              little_endian(data.size(), 8);
    const std::string common =
        std::string(8, '\0') + sizes + little_endian(name.size(), 2) + little_endian(extra.size(), 2);
    return std::pair("PK\3\4" + little_endian(45, 2) + common + name + extra + data,
                     "PK\1\2" + little_endian(45, 2) + little_endian(45, 2) + common + std::string(10, '\0') +
                         little_endian(begin, 4) + name + extra);
  };
  const auto end = [](std::uint64_t count, std::uint64_t size, std::uint64_t begin) {
    return "PK\5\6" + std::string(4, '\0') + little_endian(count, 2) + little_endian(count, 2) +
           little_endian(size, 4) + little_endian(begin, 4) + little_endian(0, 2);
  };
  const auto archive = [&](const std::string& first, const std::string& second) {
    const auto [data, entry] = member(first, npy(four_boxes), 0);
    const auto [more_data, more_entry] = member(second, npy({}), data.size());
    return data + more_data + entry + more_entry +
           end(2, entry.size() + more_entry.size(), data.size() + more_data.size());
  };
  const auto [data, entry] = member("arr_0.npy", npy(four_boxes), 0);
  const std::string one = data + entry + end(1, entry.size(), data.size());
  write_file(path("one.npz"), one);
  write_file(path("two.npz"), archive("boxes.npy", "others.npy"));
  for (const std::string file : {"one.npz", "two.npz", "- < one.npz"}) {
    const Outcome outcome = run("pairs " + file);
    expect_success(outcome);
    EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (")) << file << outcome.out;
  }
  write_file(path("bad.npz"), archive("a.npy", "b.npy"));
  expect_refused(run("pairs bad.npz"), "it has 2 arrays, none of which is called boxes");
  std::string compressed = one;
  compressed[data.size() + 10] = 8;
  write_file(path("bad.npz"), compressed);
  expect_refused(run("pairs bad.npz"), "its arrays are compressed");
  write_file(path("bad.npz"), one.substr(0, one.size() - 30));
  expect_refused(run("pairs bad.npz"), "'bad.npz': it is truncated");
  // Whatever a byte becomes, the file is read or refused.
  for (std::size_t k = 0; k < one.size(); ++k) {
    if (k >= 40 && k < data.size()) continue;  // the array itself
    std::string bytes = one;
    bytes[k] = '\xff';
    write_file(path("bad.npz"), bytes);
    try {
      (void)cli::read_boxes(path("bad.npz"));
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("bad.npz"), std::string::npos);
    }
  }
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
