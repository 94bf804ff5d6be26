// Runs the program as its users do.

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>
#include <cmath>
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
#include <set>
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
  for (const std::string option : {"--csv", "--json", "--trace"}) {
    SCOPED_TRACE(option);
    const std::vector<std::string> before = files();
    expect_refused(run("simulate --objects 5 --frames 2 --broadphase bullet-bf " + option + " /dev/full"),
                   "cannot write '/dev/full'");
    EXPECT_EQ(files(), before);
  }
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

/// A complete event of a trace; whole nanoseconds.
struct TraceEvent {
  std::string name;
  std::int64_t begin;
  std::int64_t end;
  std::size_t frame;

  [[nodiscard]] bool within(const TraceEvent& other) const {
    return begin >= other.begin && end <= other.end;
  }
};

/// The columns of a file as --csv writes it.
struct CsvRow {
  double update;
  double broad_phase;
  double total;
  std::size_t pairs;
};

std::vector<CsvRow> csv_rows(const std::string& text) {
  std::vector<CsvRow> rows;
  for (const std::string& line : lines_of(text)) {
    if (line.starts_with("frame")) continue;
    std::istringstream stream(line.substr(line.find(',') + 1));
    char comma = 0;
    CsvRow row{};
    stream >> row.update >> comma >> row.broad_phase >> comma >> row.total >> comma >> row.pairs;
    rows.push_back(row);
  }
  return rows;
}

std::int64_t nanoseconds(const json& microseconds) {
  return std::llround(microseconds.get<double>() * 1e3);
}

/// The complete events of a thread, by the thread's name.
std::vector<TraceEvent> thread_events(const json& trace, const std::string& thread) {
  int id = 0;
  for (const json& event : trace["traceEvents"]) {
    if (event["ph"] == "M" && event["name"] == "thread_name" && event["args"]["name"] == thread)
      id = event["tid"];
  }
  std::vector<TraceEvent> events;
  for (const json& event : trace["traceEvents"]) {
    if (event["ph"] != "X" || event["tid"] != id) continue;
    const std::int64_t begin = nanoseconds(event["ts"]);
    events.push_back({event["name"], begin, begin + nanoseconds(event["dur"]), event["args"]["frame"]});
  }
  return events;
}

TraceEvent find_event(const std::vector<TraceEvent>& events, const std::string& name, std::size_t frame) {
  const auto found = std::find_if(events.begin(), events.end(), [&](const TraceEvent& event) {
    return event.name == name && event.frame == frame;
  });
  if (found == events.end()) {
    ADD_FAILURE() << "no " << name << " in frame " << frame;
    return {};
  }
  return *found;
}

/// On a thread an event lies within another one or beside it, and comes after those that it lies in.
void expect_nested(const std::vector<TraceEvent>& events) {
  std::vector<TraceEvent> open;
  for (const TraceEvent& event : events) {
    EXPECT_LE(event.begin, event.end) << event.name;
    while (!open.empty() && open.back().end <= event.begin) open.pop_back();
    if (!open.empty()) {
      EXPECT_TRUE(event.within(open.back()))
          << event.name << " and " << open.back().name << " in frame " << event.frame;
    }
    open.push_back(event);
  }
}

/// Mesa's rusticl 22.3 gives all commands the same time.
bool device_clock_ticks() {
  return broadcl::select_device().platform_name != "rusticl";
}

class ProgramTrace : public Program, public testing::WithParamInterface<std::string> {
 protected:
  static constexpr std::size_t frames = 8;

  ProgramTrace() {
    expect_success(
        run("simulate --objects 60 --frames 8 --csv run.csv --trace trace.json --broadphase " + GetParam()));
    trace_ = json::parse(read_file(path("trace.json")));
    host_ = thread_events(trace_, "host");
    device_ = thread_events(trace_, "device");
    csv_ = csv_rows(read_file(path("run.csv")));
  }

  json trace_;
  std::vector<TraceEvent> host_;
  std::vector<TraceEvent> device_;
  std::vector<CsvRow> csv_;
};

TEST_P(ProgramTrace, FramesAndTheirPhasesAreThoseOfTheWorld) {
  expect_nested(host_);
  ASSERT_EQ(csv_.size(), frames);
  const auto of_milliseconds = [](double time) { return std::llround(time * 1e6); };
  for (std::size_t k = 0; k < frames; ++k) {
    const TraceEvent frame = find_event(host_, "frame", k);
    const TraceEvent prediction = find_event(host_, "prediction", k);
    const TraceEvent update = find_event(host_, "update", k);
    const TraceEvent broad_phase = find_event(host_, "broad phase", k);
    const TraceEvent rest = find_event(host_, "narrow phase and solver", k);
    EXPECT_EQ(frame.end - frame.begin, of_milliseconds(csv_[k].total));
    EXPECT_EQ(update.end - update.begin, of_milliseconds(csv_[k].update));
    EXPECT_EQ(broad_phase.end - broad_phase.begin, of_milliseconds(csv_[k].broad_phase));
    EXPECT_EQ(prediction.begin, frame.begin);
    EXPECT_LE(prediction.end, update.begin);
    EXPECT_LE(update.end, broad_phase.begin);
    EXPECT_LE(broad_phase.end, rest.begin);
    EXPECT_EQ(rest.end, frame.end);
    if (k > 0) {
      EXPECT_LE(find_event(host_, "frame", k - 1).end, frame.begin);
    }
  }
  EXPECT_EQ(host_.front().name, "frame");
  EXPECT_EQ(host_.front().begin, 0);
}

TEST_P(ProgramTrace, CountsThePairs) {
  std::vector<std::size_t> counted;
  for (const json& event : trace_["traceEvents"]) {
    if (event["ph"] != "C") continue;
    EXPECT_EQ(event["name"], "pairs");
    EXPECT_EQ(nanoseconds(event["ts"]), find_event(host_, "broad phase", counted.size()).end);
    counted.push_back(event["args"]["pairs"]);
  }
  std::vector<std::size_t> expected;
  for (const CsvRow& row : csv_) expected.push_back(row.pairs);
  EXPECT_EQ(counted, expected);
  EXPECT_GT(counted.back(), 0U);
}

TEST_P(ProgramTrace, TellsWhatWasRun) {
  EXPECT_EQ(trace_["displayTimeUnit"], "ms");
  const json& facts = trace_["otherData"];
  EXPECT_EQ(facts["config"]["scenario"], "mixed-sizes");
  EXPECT_EQ(facts["config"]["objects"], 60);
  EXPECT_EQ(facts["config"]["broadphase"], GetParam());
  EXPECT_EQ("broadcl " + facts["versions"]["broadcl"].get<std::string>() + "\n", run("--version").out);
  if (GetParam().starts_with("bullet-")) {
    EXPECT_TRUE(facts["device"].is_null());
  } else {
    EXPECT_EQ(facts["device"]["id"], broadcl::select_device().id());
  }
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramTrace, testing::Values("bullet-bvh", "gpu-bf", "brute-force"),
                         [](const auto& test) {
                           std::string name = test.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

class ProgramStages : public ProgramTrace {
 protected:
  using Names = std::vector<std::string>;
  /// On the host, in order; those of a frame in the steady state.
  [[nodiscard]] static Names host_names() {
    if (GetParam() == "gpu-bf") return {"upload", "test", "download", "wait", "xor"};
    return {"upload", "test", "sweep", "order", "download", "wait"};
  }
  [[nodiscard]] static Names device_names() {
    if (GetParam() == "gpu-bf") return {"upload", "test", "download"};
    return {"upload", "test", "sweep", "order", "download"};
  }
};

TEST_P(ProgramStages, LieInTheBroadPhaseOfTheirFrame) {
  for (std::size_t frame = 0; frame < frames; ++frame) {
    const TraceEvent broad_phase = find_event(host_, "broad phase", frame);
    std::int64_t sum = 0;
    Names names;
    for (const TraceEvent& event : host_) {
      const Names all = host_names();
      if (event.frame != frame || std::find(all.begin(), all.end(), event.name) == all.end()) continue;
      EXPECT_TRUE(event.within(broad_phase)) << event.name;
      names.push_back(event.name);
      sum += event.end - event.begin;
    }
    EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), host_names().size());
    EXPECT_GT(sum, 0);
    EXPECT_LE(sum, broad_phase.end - broad_phase.begin);
  }
}

TEST_P(ProgramStages, OfTheDeviceFollowOneAnother) {
  for (std::size_t frame = 1; frame < frames; ++frame) {
    std::vector<TraceEvent> events;
    std::copy_if(device_.begin(), device_.end(), std::back_inserter(events),
                 [&](const TraceEvent& event) { return event.frame == frame; });
    Names names;
    for (const TraceEvent& event : events) names.push_back(event.name);
    EXPECT_EQ(names, device_names());
    if (device_clock_ticks()) {
      for (std::size_t k = 1; k < events.size(); ++k)
        EXPECT_LE(events[k - 1].end, events[k].begin) << names[k];
    }
    // The clocks of host and device differ, but a command neither starts before its update nor outlasts its
    // wait.
    EXPECT_GE(events.front().begin, find_event(host_, "broad phase", frame).begin);
    EXPECT_LE(events.back().end, find_event(host_, "wait", frame).end);
  }
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramStages, testing::Values("gpu-bf", "brute-force"),
                         [](const auto& test) {
                           std::string name = test.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(ProgramStages, AreReportedWithProfile) {
  const Outcome outcome =
      run("simulate --objects 60 --frames 8 --profile --json run.json --broadphase " + GetParam());
  expect_success(outcome);
  const json summary = json::parse(read_file(path("run.json")));
  const double broad_phase = summary["milliseconds"]["broad_phase"]["mean"];
  double sum = 0;
  Names names;
  const std::size_t table = outcome.out.find("\nstages of the broad phase ");
  ASSERT_NE(table, std::string::npos) << outcome.out;
  std::size_t place = table;
  for (const json& stage : summary["stages"]) {
    names.push_back(stage["name"]);
    place = outcome.out.find("\n" + names.back() + " ", place + 1);
    ASSERT_NE(place, std::string::npos) << names.back() << " is not in its place in\n" << outcome.out;
    std::istringstream row(outcome.out.substr(place + 1 + names.back().size()));
    for (const std::string side : {"host", "device"}) {
      for (const std::string column : {"mean", "median", "p95"}) {
        double shown = -1;
        row >> shown;
        EXPECT_NEAR(shown, stage[side + "_milliseconds"][column].get<double>(), 1e-4) << names.back();
      }
    }
    const double mean = stage["host_milliseconds"]["mean"];
    EXPECT_NEAR(stage["share_of_broad_phase"].get<double>(), mean / broad_phase, 1e-9);
    Names device = device_names();
    device.emplace_back("apply");
    EXPECT_EQ(stage["device_milliseconds"]["mean"].get<double>() > 0,
              std::find(device.begin(), device.end(), names.back()) != device.end())
        << names.back();
    sum += mean;
  }
  // In the first frame all objects are new.
  Names expected = host_names();
  if (GetParam() == "brute-force") expected.insert(expected.begin() + 1, "apply");
  EXPECT_EQ(names, expected);
  EXPECT_LE(sum, broad_phase);
}

TEST_F(Program, SimulateReportsStagesOnlyWithProfile) {
  const Outcome outcome = run("simulate --objects 5 --frames 2 --json run.json --trace trace.json");
  expect_success(outcome);
  EXPECT_EQ(outcome.out.find("stages"), std::string::npos) << outcome.out;
  EXPECT_TRUE(json::parse(read_file(path("run.json")))["stages"].is_null());
}

TEST_F(Program, SimulateSaysThatABroadPhaseHasNoStages) {
  for (const std::string broadphase : {"bullet-bf", "bullet-sap", "bullet-bvh", "oracle"}) {
    const Outcome outcome =
        run("simulate --objects 5 --frames 2 --profile --json run.json --broadphase " + broadphase);
    expect_success(outcome);
    EXPECT_EQ(lines_of(outcome.out).back(), "The broad phase " + broadphase + " has no stages.");
    EXPECT_EQ(json::parse(read_file(path("run.json")))["stages"], json::array());
  }
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
    {"SimulateTraceIsDirectory", "simulate --csv run.csv --trace folder", "'folder' is a directory"},
    {"SimulateTraceInMissingFolder", "simulate --trace missing/trace.json", "missing/trace.json"},
    {"SimulateTraceInUnwritableFolder", "simulate --trace /proc/trace.json", "'/proc/trace.json'"},
    {"SimulateTraceWithoutFile", "simulate --trace", "--trace"},
    {"SimulateOneFileForCsvAndTrace", "simulate --csv run --trace ./run",
     "--csv and --trace name the same file"},
    {"SimulateOneFileForJsonAndTrace", "simulate --json run --trace folder/../run",
     "--json and --trace name"},
    {"SimulateTraceOfUnknownBroadphase", "simulate --broadphase frobnicate --trace run.json", "bullet-bvh"},
    {"SimulateProfileWithValue", "simulate --profile=maybe", "profile"},

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
