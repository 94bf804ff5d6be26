// Runs the program as its users do.

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <ostream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "cli/statistics.hpp"
#include "environment.hpp"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct Outcome {
  int exit_code;
  std::string out;
  std::string err;
};

std::string read_file(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void write_file(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

/// A .npy array of float32 of shape (rows, columns).
std::string npy(const std::vector<float>& values, std::size_t columns = 6) {
  const std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" +
                             std::to_string(values.size() / columns) + ", " + std::to_string(columns) +
                             "), }\n";
  std::string bytes("\x93NUMPY\1\0", 8);
  bytes += {static_cast<char>(header.size()), '\0'};
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  return bytes;
}

/// 0-1 and 1-2 touch, 3 is far away.
const std::vector<float> four_boxes = {0, 0, 0, 1, 1, 1, 1, 0, 0, 2,  1,  1,  //
                                       2, 0, 0, 3, 1, 1, 9, 9, 9, 10, 10, 10};

/// A folder of its own for each test, with some files in it; the program runs in it.
class Program : public testing::Test {
 protected:
  Program() {
    fs::create_directory(path("folder"));
    write_file(path("four.npy"), npy(four_boxes));
    std::vector<float> boxes = four_boxes;
    boxes[8] = std::numeric_limits<float>::quiet_NaN();
    write_file(path("nan.npy"), npy(boxes));
    write_file(path("wrong-shape.npy"), npy(four_boxes, 3));
    write_file(path("cut.npy"), npy(four_boxes).substr(0, 150));
    write_file(path("text.npy"), "0 0 0 1 1 1\n");
    write_file(path("empty.npy"), "");
    fs::create_symlink("nowhere/to/be/found", path("dangling"));
  }

  /// Runs the program with arguments as a shell takes them.
  [[nodiscard]] Outcome run(const std::string& arguments, const std::string& environment = "") const {
    const std::string command = "cd '" + folder_.path().string() + "' && " + environment +
                                " '" BROADCL_PROGRAM_PATH "' " + arguments + " >stdout.txt 2>stderr.txt";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("stdout.txt")),
            read_file(path("stderr.txt"))};
  }

  /// The names of all files in the folder, but for those that catch the output.
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path())) {
      if (entry.path().extension() != ".txt") names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  [[nodiscard]] fs::path path(const std::string& name) const { return folder_.path() / name; }

 private:
  broadcl::test::ScopedFolder folder_;
};

void expect_success(const Outcome& outcome) {
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.err, "");
}

void expect_refused(const Outcome& outcome, const std::string& message) {
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_TRUE(outcome.err.starts_with("broadcl: ")) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_TRUE(outcome.err.ends_with("\n"));
  EXPECT_NE(outcome.err.find(message), std::string::npos) << outcome.err;
}

TEST_F(Program, Version) {
  const Outcome outcome = run("--version");
  expect_success(outcome);
  EXPECT_TRUE(std::regex_match(outcome.out, std::regex(R"(broadcl \d+\.\d+\.\d+\n)"))) << outcome.out;
}

TEST_F(Program, HelpForAll) {
  for (const std::string verb : {"", "devices", "simulate", "pairs", "check"}) {
    const Outcome outcome = run(verb + " --help");
    expect_success(outcome);
    EXPECT_NE(outcome.out.find("--help"), std::string::npos) << verb;
  }
}

TEST_F(Program, HelpListsTheTables) {
  const std::string simulate = run("simulate --help").out;
  for (const std::string name : {"mixed-sizes", "bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf"}) {
    EXPECT_NE(simulate.find("\n  " + name + " "), std::string::npos) << name;
  }
  const std::string pairs = run("pairs --help").out;
  for (const broadcl::AlgorithmInfo& algorithm : broadcl::algorithms()) {
    EXPECT_NE(pairs.find("\n  " + std::string(algorithm.name) + " "), std::string::npos) << algorithm.name;
  }
}

TEST_F(Program, DevicesListsEveryDevice) {
  const Outcome outcome = run("devices");
  expect_success(outcome);
  std::size_t defaults = 0;
  const std::vector<std::string> lines = lines_of(outcome.out);
  for (const broadcl::Device& device : broadcl::devices()) {
    const auto line = std::find_if(lines.begin(), lines.end(), [&](const std::string& text) {
      return text.find(" " + device.id() + " ") != std::string::npos &&
             text.find(device.label()) != std::string::npos;
    });
    ASSERT_NE(line, lines.end()) << device.id() << " is not in\n" << outcome.out;
    if (line->starts_with("*")) {
      ++defaults;
      EXPECT_EQ(device.id(), broadcl::select_device().id());
    }
  }
  EXPECT_EQ(defaults, 1U);
}

TEST_F(Program, DevicesAsJson) {
  const Outcome outcome = run("devices --json");
  expect_success(outcome);
  const json list = json::parse(outcome.out);
  const std::vector<broadcl::Device> devices = broadcl::devices();
  ASSERT_EQ(list.size(), devices.size());
  for (std::size_t i = 0; i < devices.size(); ++i) {
    EXPECT_EQ(list[i]["id"], devices[i].id());
    EXPECT_EQ(list[i]["type"], broadcl::to_string(devices[i].type));
    EXPECT_EQ(list[i]["memory"], devices[i].memory);
    EXPECT_EQ(list[i]["max_allocation"], devices[i].max_allocation);
    EXPECT_EQ(list[i]["compute_units"], devices[i].compute_units);
    EXPECT_EQ(list[i]["default"], devices[i].id() == broadcl::select_device().id());
  }
}

TEST_F(Program, OneOfSeveralDevicesIsTheDefault) {
  const Outcome outcome = run("devices --json", "RUSTICL_ENABLE=llvmpipe");
  expect_success(outcome);
  const json list = json::parse(outcome.out);
  EXPECT_EQ(
      std::count_if(list.begin(), list.end(), [](const json& device) { return device["default"] == true; }),
      1);
}

TEST_F(Program, WithoutAnyDeviceSaysWhatToInstall) {
  if (run("devices", "OCL_ICD_VENDORS=/nonexistent").exit_code == 0) {
    GTEST_SKIP() << "this OpenCL loader does not heed OCL_ICD_VENDORS, so devices cannot be hidden";
  }
  for (const std::string arguments : {"devices", "check", "pairs four.npy", "simulate --frames 1"}) {
    SCOPED_TRACE(arguments);
    expect_refused(run(arguments, "OCL_ICD_VENDORS=/nonexistent"), "install");
  }
}

TEST_F(Program, HostAlgorithmNeedsNoDevice) {
  const Outcome outcome = run("pairs four.npy --algorithm oracle", "OCL_ICD_VENDORS=/nonexistent");
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with("2 overlapping pairs of 4 boxes (oracle on the host)")) << outcome.out;
}

TEST_F(Program, PairsOfEveryAlgorithm) {
  for (const broadcl::AlgorithmInfo& algorithm : broadcl::algorithms()) {
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

TEST_F(Program, FullDiskIsAnError) {
  expect_refused(run("pairs four.npy --out /dev/full"), "cannot write '/dev/full'");
  expect_refused(run("simulate --objects 5 --frames 2 --broadphase bullet-bf --csv /dev/full"), "/dev/full");
}

TEST_F(Program, LostStandardOutputIsAnError) {
  for (const std::string arguments : {"--version", "devices", "pairs four.npy"}) {
    const std::string command = "cd '" + path("").string() + "' && '" BROADCL_PROGRAM_PATH "' " + arguments +
                                " >/dev/full 2>stderr.txt";
    EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 2) << arguments;
    EXPECT_EQ(read_file(path("stderr.txt")), "broadcl: cannot write to standard output\n");
  }
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

class ProgramSimulate : public Program, public testing::WithParamInterface<std::string> {};

TEST_P(ProgramSimulate, VerifiesAndReports) {
  const Outcome outcome =
      run("simulate --scenario mixed-sizes --objects 40 --frames 12 --seed 7 --verify --csv run.csv "
          "--json run.json --broadphase " +
          GetParam());
  expect_success(outcome);
  for (const std::string part : {"mixed-sizes, 40 cubes, 12 frames, seed 7", "\nupdate ", "\nbroad phase ",
                                 "\ntotal ", "\npairs ", "\ndevice ", "\nverified "}) {
    EXPECT_NE(outcome.out.find(part), std::string::npos) << part << " is not in\n" << outcome.out;
  }

  const std::vector<std::string> rows = lines_of(read_file(path("run.csv")));
  ASSERT_EQ(rows.size(), 13U);
  EXPECT_EQ(rows[0], "frame,update_ms,broad_phase_ms,total_ms,pairs");
  double sum_of_totals = 0;
  unsigned last_pairs = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    std::istringstream row(rows[i]);
    std::size_t frame = 0;
    double update = 0;
    double broad_phase = 0;
    double total = 0;
    std::string commas(4, ' ');
    row >> frame >> commas[0] >> update >> commas[1] >> broad_phase >> commas[2] >> total >> commas[3] >>
        last_pairs;
    ASSERT_TRUE(row && row.peek() == EOF) << rows[i];
    EXPECT_EQ(commas, ",,,,");
    EXPECT_EQ(frame, i - 1);
    EXPECT_GT(update, 0);
    EXPECT_GT(broad_phase, 0);
    EXPECT_GE(total, update + broad_phase);
    sum_of_totals += total;
  }

  const json summary = json::parse(read_file(path("run.json")));
  const json config = {
      {"scenario", "mixed-sizes"}, {"objects", 40}, {"shape", "cube"}, {"seed", 7}, {"frames", 12},
      {"broadphase", GetParam()},  {"device", ""}};
  EXPECT_EQ(summary["config"], config);
  EXPECT_EQ("broadcl " + summary["versions"]["broadcl"].get<std::string>() + "\n", run("--version").out);
  EXPECT_EQ(summary["device"].is_null(), GetParam().starts_with("bullet-"));
  EXPECT_NEAR(summary["milliseconds"]["total"]["mean"].get<double>(), sum_of_totals / 12, 1e-5);
  for (const std::string stage : {"update", "broad_phase", "total"}) {
    const json& times = summary["milliseconds"][stage];
    EXPECT_GE(times["p95"].get<double>(), times["median"].get<double>());
    EXPECT_GT(times["first_frame"].get<double>(), 0);
  }
  EXPECT_EQ(summary["pairs"]["last"], last_pairs);
  EXPECT_EQ(summary["verify"]["equal"], true);
  EXPECT_EQ(summary["verify"]["missing_pairs"], 0);
  EXPECT_TRUE(summary["verify"]["first_wrong_frame"].is_null());
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramSimulate,
                         testing::Values("bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf"),
                         [](const auto& test) {
                           std::string name = test.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_F(Program, SimulateHasTheSamePairsInEveryRun) {
  std::vector<std::vector<std::string>> pairs;
  for (int i = 0; i < 2; ++i) {
    expect_success(run("simulate --scenario agitated --objects 60 --frames 20 --spheres --csv run.csv"));
    pairs.emplace_back();
    for (const std::string& row : lines_of(read_file(path("run.csv")))) {
      pairs.back().push_back(row.substr(row.rfind(',')));
    }
    EXPECT_EQ(pairs.back().size(), 21U);
  }
  EXPECT_EQ(pairs[0], pairs[1]);
}

TEST(Summary, InterpolatesBetweenNeighbours) {
  const broadcl::cli::Summary odd = broadcl::cli::summarize({9, 1, 2});
  EXPECT_DOUBLE_EQ(odd.mean, 4);
  EXPECT_DOUBLE_EQ(odd.median, 2);
  EXPECT_DOUBLE_EQ(odd.p95, 8.3);
  const broadcl::cli::Summary even = broadcl::cli::summarize({4, 3, 2, 1});
  EXPECT_DOUBLE_EQ(even.median, 2.5);
  const broadcl::cli::Summary one = broadcl::cli::summarize({5});
  EXPECT_DOUBLE_EQ(one.mean, 5);
  EXPECT_DOUBLE_EQ(one.median, 5);
  EXPECT_DOUBLE_EQ(one.p95, 5);
}

TEST_F(Program, CheckWorksHere) {
  const Outcome outcome = run("check");
  expect_success(outcome);
  EXPECT_EQ(lines_of(outcome.out).back(), "BroadCL works here.");
  for (const broadcl::AlgorithmInfo& algorithm : broadcl::algorithms()) {
    EXPECT_NE(outcome.out.find("\n  " + std::string(algorithm.name) + " "), std::string::npos) << outcome.out;
  }
}

TEST_F(Program, CheckTakesADevice) {
  const Outcome outcome = run("check --device " + broadcl::select_device().id());
  expect_success(outcome);
  EXPECT_TRUE(outcome.out.starts_with(broadcl::select_device().label())) << outcome.out;
}

/// Kernels that find pairs where there are none.
class ProgramWrongKernels : public Program {
 protected:
  ProgramWrongKernels() {
    fs::copy(BROADCL_KERNEL_FOLDER, path("kernels"));
    std::string header = read_file(path("kernels/aabb.h"));
    const std::string condition = "(s_lower_x) <= (t_upper_x)";
    header.replace(header.find(condition), condition.size(), "(s_lower_x) == (s_lower_x)");
    write_file(path("kernels/aabb.h"), header);
  }
  const std::string environment_ = "BROADCL_KERNEL_DIR=kernels BROADCL_CACHE_DIR=cache";
};

TEST_F(ProgramWrongKernels, CheckSaysThatItDoesNotWork) {
  const Outcome outcome = run("check", environment_);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(lines_of(outcome.out).back(), "BroadCL does not work here.");
  EXPECT_TRUE(std::regex_search(outcome.out, std::regex("\n  gpu-bf +WRONG: scene '.*extra, the first \\(")))
      << outcome.out;
  EXPECT_TRUE(std::regex_search(outcome.out, std::regex("\n  oracle +right in "))) << outcome.out;
}

TEST_F(ProgramWrongKernels, SimulateNamesTheFirstWrongFrame) {
  const Outcome outcome = run("simulate --objects 40 --frames 3 --verify --json run.json", environment_);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  EXPECT_NE(outcome.out.find("\nverified      WRONG, first in frame 0; "), std::string::npos) << outcome.out;
  const json verdict = json::parse(read_file(path("run.json")))["verify"];
  EXPECT_EQ(verdict["equal"], false);
  EXPECT_EQ(verdict["first_wrong_frame"], 0);
  EXPECT_EQ(verdict["missing_pairs"], 0);
  EXPECT_GT(verdict["extra_pairs"], 0);
}

struct BadInput {
  std::string name;
  std::string arguments;
  std::string message;  ///< Part of the line on stderr.

  friend std::ostream& operator<<(std::ostream& stream, const BadInput& bad) {
    return stream << bad.arguments;
  }
};

class ProgramBadInput : public Program, public testing::WithParamInterface<BadInput> {};

TEST_P(ProgramBadInput, IsRefusedAndLeavesNothing) {
  const std::vector<std::string> before = files();
  expect_refused(run(GetParam().arguments), GetParam().message);
  EXPECT_EQ(files(), before);
}

const std::vector<BadInput> bad_inputs = {
    {"NoVerb", "", "verb is missing"},
    {"UnknownVerb", "frobnicate", "frobnicate"},
    {"TwoVerbs", "devices check", "check"},
    {"UnknownOption", "--frobnicate", "--frobnicate"},
    {"LineBreakInOption", "\"--frob\nnicate\"", "--frob nicate"},
    {"DevicesUnknownOption", "devices --frobnicate", "--frobnicate"},
    {"DevicesExtraArgument", "devices 0:0", "0:0"},
    {"SimulateUnknownOption", "simulate --frobnicate", "--frobnicate"},
    {"PairsUnknownOption", "pairs four.npy --frobnicate", "--frobnicate"},
    {"CheckUnknownOption", "check --frobnicate", "--frobnicate"},
    {"OptionWithoutValue", "check --device", "--device"},
    {"OptionTwice", "simulate --objects 5 --objects 6", "--objects"},
    {"FlagWithValue", "simulate --spheres=maybe", "spheres"},

    {"PairsNoFile", "pairs", "FILE"},
    {"PairsTwoFiles", "pairs four.npy four.npy", "four.npy"},
    {"PairsMissingFile", "pairs missing.npy", "'missing.npy'"},
    {"PairsLineBreakInFile", "pairs 'missing\n.npy'", "'missing .npy'"},
    {"PairsDirectory", "pairs folder", "'folder' is a directory"},
    {"PairsDanglingLink", "pairs dangling", "'dangling'"},
    {"PairsEmptyFile", "pairs empty.npy", "'empty.npy'"},
    {"PairsText", "pairs text.npy", "not a NumPy array"},
    {"PairsWrongShape", "pairs wrong-shape.npy", "(8, 3)"},
    {"PairsNan", "pairs nan.npy --out pairs.npy", "row 1 "},
    {"PairsCut", "pairs cut.npy --out pairs.npy", "is cut"},
    {"PairsUnknownAlgorithm", "pairs four.npy --algorithm frobnicate --out pairs.npy", "gpu-bf"},
    {"PairsUnknownDevice", "pairs four.npy --device frobnicate --out pairs.npy", "'frobnicate'"},
    {"PairsUnknownDeviceOnHost", "pairs four.npy --algorithm oracle --device frobnicate", "'frobnicate'"},
    {"PairsOutIsDirectory", "pairs four.npy --out folder", "'folder' is a directory"},
    {"PairsOutInMissingFolder", "pairs four.npy --out missing/pairs.npy", "missing/pairs.npy"},
    {"PairsOutInFile", "pairs four.npy --out text.npy/pairs.npy", "text.npy/pairs.npy"},
    {"PairsOutCannotBeReplaced", "pairs four.npy --out /proc/version", "'/proc/version'"},
    {"PairsOutIsInput", "pairs four.npy --out ./four.npy", "--out"},

    {"SimulateUnknownScenario", "simulate --scenario frobnicate --csv run.csv", "mixed-sizes"},
    {"SimulateUnknownBroadphase", "simulate --broadphase frobnicate --csv run.csv", "bullet-bvh"},
    {"SimulateUnknownDevice", "simulate --device frobnicate --csv run.csv", "'frobnicate'"},
    {"SimulateUnknownDeviceOnHost", "simulate --broadphase bullet-bf --device frobnicate", "'frobnicate'"},
    {"SimulateNegativeObjects", "simulate --objects -5", "--objects: '-5' is not a whole number"},
    {"SimulateZeroObjects", "simulate --objects 0", "--objects: '0'"},
    {"SimulateFractionalObjects", "simulate --objects 2.5", "--objects: '2.5'"},
    {"SimulateHexadecimalObjects", "simulate --objects 0x10", "--objects: '0x10'"},
    {"SimulateTooManyObjects", "simulate --objects 4294967297", "--objects: '4294967297'"},
    {"SimulateEmptyObjects", "simulate --objects ''", "--objects"},
    {"SimulateObjectsInWords", "simulate --objects many", "--objects: 'many'"},
    {"SimulateNegativeFrames", "simulate --frames -1", "--frames: '-1'"},
    {"SimulateZeroFrames", "simulate --frames 0", "--frames: '0'"},
    {"SimulateNegativeSeed", "simulate --seed -1", "--seed: '-1'"},
    {"SimulateHugeSeed", "simulate --seed 18446744073709551616", "--seed"},
    {"SimulateCsvIsDirectory", "simulate --csv folder", "'folder' is a directory"},
    {"SimulateJsonIsDirectory", "simulate --csv run.csv --json folder", "'folder' is a directory"},
    {"SimulateCsvInMissingFolder", "simulate --csv missing/run.csv", "missing/run.csv"},
    {"SimulateOneFileForBoth", "simulate --csv run --json ./run", "same file"},

    {"LineBreakInScenario", "simulate --scenario 'a\nb'", "'a b'"},
    {"LineBreakInBroadphase", "simulate --broadphase 'a\nb'", "'a b'"},
    {"LineBreakInAlgorithm", "pairs four.npy --algorithm 'a\nb'", "'a b'"},
    {"LineBreakInDevice", "check --device 'a\nb'", "'a b'"},

    {"CheckUnknownDevice", "check --device frobnicate", "'frobnicate'"},
    {"CheckDeviceNumberTooLarge", "check --device 99:0", "'99:0'"},
};

INSTANTIATE_TEST_SUITE_P(All, ProgramBadInput, testing::ValuesIn(bad_inputs),
                         [](const auto& test) { return test.param.name; });

}  // namespace
