// `broadcl study`, run as users run it.
#include <algorithm>
#include <csignal>
#include <cstddef>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <broadcl/device.hpp>

#include "cli/recording.hpp"
#include "cli/study_plan.hpp"
#include "cli/study_run_file.hpp"

#include "base/system.hpp"
#include "program.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

const std::string scenes_and_sizes =
    "study --scenarios free-fall,mixed-sizes --objects 50,80 --frames 6 --repeat 2 --out s";
const std::string tiny = scenes_and_sizes + " --broadphases bullet-bf,tiles";
const std::string tiny_on_host = scenes_and_sizes + " --broadphases bullet-bf,sweep-and-prune";

cli::StudySettings settings_of_tiny(const std::string& second_broadphase) {
  return {.preset = "quick",
          .scenarios = {"free-fall", "mixed-sizes"},
          .objects = {50, 80},
          .broadphases = {"bullet-bf", second_broadphase},
          .frames = 6,
          .repeat = 2,
          .limits = {},
          .left_out = {}};
}

/// The content of a file and the time when it was written.
struct File {
  std::string bytes;
  fs::file_time_type time;

  friend bool operator==(const File&, const File&) = default;
};

class ProgramStudy : public Program {
 protected:
  /// The files in runs/, by name.
  [[nodiscard]] std::map<std::string, File> run_files() const {
    std::map<std::string, File> found;
    if (!fs::exists(path("s/runs"))) return found;
    for (const fs::directory_entry& entry : fs::directory_iterator(path("s/runs"))) {
      const std::string name = entry.path().filename().string();
      if (entry.path().extension() == ".csv") found[name] = {read_file(entry), entry.last_write_time()};
    }
    return found;
  }

  [[nodiscard]] std::vector<std::string> table() const { return lines_of(read_file(path("s/study.csv"))); }
};

std::vector<std::string> names_of(const std::vector<cli::StudyRun>& runs) {
  std::vector<std::string> names(runs.size());
  std::transform(runs.begin(), runs.end(), names.begin(), cli::file_name);
  return names;
}

template <class Map>
std::vector<std::string> keys_of(const Map& map) {
  std::vector<std::string> keys(map.size());
  std::transform(map.begin(), map.end(), keys.begin(), [](const auto& entry) { return entry.first; });
  return keys;
}

TEST_F(ProgramStudy, WritesARowAndAFileForEachRun) {
  const Outcome outcome = run(tiny + " --seed 3 --frames-csv frames.csv");
  expect_success(outcome);
  EXPECT_THAT(outcome.out, HasSubstr("16 of 16 runs done"));
  EXPECT_THAT(outcome.out, HasSubstr("\nmixed-sizes            80 "));
  EXPECT_THAT(outcome.out, HasSubstr("scripts/report 's'"));

  const std::vector<std::string> devices = {select_device().label()};
  const std::vector<cli::StudyRun> runs = cli::planned_runs(settings_of_tiny("tiles"), devices);
  const std::map<std::string, File> written = run_files();
  EXPECT_THAT(keys_of(written), testing::UnorderedElementsAreArray(names_of(runs)));
  const std::vector<std::string> rows = table();
  ASSERT_EQ(rows.size(), runs.size() + 1);
  EXPECT_EQ(rows[0],
            "scenario,objects,frames,repeat,broadphase,device,update_mean_ms,update_median_ms,update_p95_ms,"
            "broad_phase_mean_ms,broad_phase_median_ms,broad_phase_p95_ms,total_mean_ms,total_median_ms,"
            "total_p95_ms,total_sum_ms,pairs_mean,pairs_last,first_frame_total_ms");
  const std::vector<std::string> frames = lines_of(read_file(path("frames.csv")));
  ASSERT_EQ(frames.size(), 6 * runs.size() + 1);
  EXPECT_EQ(frames[0],
            "scenario,objects,repeat,broadphase,device,frame,update_ms,broad_phase_ms,total_ms,pairs");
  for (std::size_t k = 0; k < runs.size(); ++k) {
    const std::string& file = written.at(file_name(runs[k])).bytes;
    const auto parsed = cli::parse_run_file(file, 6);
    ASSERT_TRUE(parsed) << file;
    const cli::RunSummary summary = cli::summarize_run(*parsed);
    const std::string& device = runs[k].device;
    const std::string scene = runs[k].scenario + "," + std::to_string(runs[k].objects) + ",";
    const std::string end = std::to_string(runs[k].repeat) + "," + runs[k].broadphase + "," + device + ",";
    EXPECT_THAT(rows[k + 1], testing::StartsWith(std::string(scene).append("6,").append(end)));
    std::istringstream numbers(rows[k + 1].substr(rows[k + 1].find(end) + end.size()));
    std::vector<double> values;
    for (std::string value; std::getline(numbers, value, ',');) values.push_back(std::stod(value));
    ASSERT_EQ(values.size(), 13U);
    EXPECT_NEAR(values[0], summary.update.mean, 1e-6);
    EXPECT_NEAR(values[5], summary.broad_phase.p95, 1e-6);
    EXPECT_NEAR(values[7], summary.total.median, 1e-6);
    EXPECT_NEAR(values[9], summary.total_sum, 1e-6);
    EXPECT_NEAR(values[11], static_cast<double>(summary.pairs_last), 0);
    EXPECT_NEAR(values[12], summary.first_frame_total, 1e-6);
    const std::string last_frame = lines_of(file)[6];
    EXPECT_EQ(frames[6 * k + 6], std::string(scene).append(end).append(last_frame));
  }
}

TEST_F(ProgramStudy, StoresAllThatIsNeededToRepeatIt) {
  expect_success(run(tiny + " --seed 3 --most bullet-bf=70"));
  const json study = json::parse(read_file(path("s/study.json")));
  EXPECT_EQ(study["format"], 1);
  EXPECT_EQ(study["preset"], "quick");
  EXPECT_EQ("broadcl " + study["versions"]["broadcl"].get<std::string>() + "\n", run("--version").out);
  EXPECT_EQ(study["versions"]["bullet"], "3.24");
  EXPECT_FALSE(study["host"]["cpu"].get<std::string>().empty());
  EXPECT_EQ(study["host"]["threads"], std::thread::hardware_concurrency());
  EXPECT_FALSE(study["host"]["system"].get<std::string>().empty());
  EXPECT_GT(study["overhead_us"], 0);
  EXPECT_LT(study["overhead_us"], 20);
  EXPECT_EQ(study["seed"], 3);
  EXPECT_EQ(study["repeat"], 2);
  EXPECT_EQ(study["frames"], 6);
  EXPECT_EQ(study["warm_up_frames"], 1);
  EXPECT_EQ(study["scenarios"], json({"free-fall", "mixed-sizes"}));
  EXPECT_EQ(study["objects"], json({50, 80}));
  EXPECT_EQ(study["broadphases"][0]["name"], "bullet-bf");
  EXPECT_EQ(study["broadphases"][0]["bullet"], true);
  EXPECT_EQ(study["broadphases"][1]["exact"], true);
  EXPECT_EQ(study["devices"][0]["label"], select_device().label());
  EXPECT_EQ(study["devices"][0]["driver_version"], select_device().driver_version);
  EXPECT_EQ(study["cut"][0], "bullet-bf at more than 70 objects");

  // A recording of each scenario, with the larger number of objects.
  for (const std::string scenario : {"free-fall", "mixed-sizes"}) {
    cli::RecordingReader recording(path("s/recordings/" + scenario + ".npy"));
    EXPECT_EQ(recording.boxes(), 80U);
    EXPECT_EQ(recording.frames(), 6U);
  }

  std::string command = study["command"];
  ASSERT_TRUE(command.starts_with("broadcl study ") && command.ends_with(" --out s")) << command;
  command = command.substr(8, command.size() - 8 - 1) + "again";
  expect_success(run(command));
  json again = json::parse(read_file(path("again/study.json")));
  for (const std::string key : {"command", "date", "overhead_us", "devices"}) again[key] = study[key];
  EXPECT_EQ(again, study);
}

TEST_F(ProgramStudy, GoesOnAfterAnInterruption) {
  // Runs long enough to be killed before they end.
  const std::string longer =
      "study --scenarios free-fall,mixed-sizes --objects 200,300 --frames 30 "
      "--repeat 2 --broadphases bullet-bf,sweep-and-prune --out s";
  cli::StudySettings settings = settings_of_tiny("sweep-and-prune");
  settings.objects = {200, 300};
  const std::vector<cli::StudyRun> runs = cli::planned_runs(settings, {});
  const std::vector<std::string> order = names_of(cli::in_random_order(runs, 1));
  std::map<std::string, File> before;
  for (const auto& [done, signal] : {std::pair(3U, SIGINT), std::pair(7U, SIGKILL)}) {
    const std::size_t enough = done;
    run_until([&] { return run_files().size() >= enough; }, signal, longer);
    const std::map<std::string, File> files = run_files();
    ASSERT_LT(files.size(), runs.size());
    EXPECT_THAT(keys_of(files), testing::UnorderedElementsAreArray(std::vector<std::string>(
                                    order.begin(), order.begin() + static_cast<long>(files.size()))));
    for (const auto& [name, file] : before) EXPECT_EQ(files.at(name), file) << name;
    before = files;
  }
  expect_success(run("study --out s"));
  const std::map<std::string, File> files = run_files();
  EXPECT_THAT(keys_of(files), testing::UnorderedElementsAreArray(order));
  for (const auto& [name, file] : before) EXPECT_EQ(files.at(name), file) << name;
  EXPECT_EQ(table().size(), runs.size() + 1);
}

TEST_F(ProgramStudy, MakesDamagedRunsAgainAndNoOthers) {
  expect_success(run(tiny_on_host));
  const std::map<std::string, File> before = run_files();
  const std::vector<std::string> table_before = table();
  const std::vector<std::string> damaged = {"free-fall-50-bullet-bf-1.csv", "free-fall-80-bullet-bf-2.csv",
                                            "mixed-sizes-50-sweep-and-prune-1.csv"};
  const auto cut_at = [&](const std::string& name, std::size_t size) {
    write_file(path("s/runs/" + name), before.at(name).bytes.substr(0, size));
  };
  cut_at(damaged[0], 0);
  cut_at(damaged[1], before.at(damaged[1]).bytes.size() - 3);
  const std::string& whole = before.at(damaged[2]).bytes;
  cut_at(damaged[2], whole.rfind('\n', whole.size() - 2) + 1);  // one row fewer
  fs::remove(path("s/study.csv"));

  const Outcome outcome = run(tiny_on_host);
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(lines_of(outcome.err).size(), damaged.size()) << outcome.err;
  for (const std::string& name : damaged) EXPECT_THAT(outcome.err, HasSubstr("/" + name + "' is damaged"));
  const std::map<std::string, File> after = run_files();
  EXPECT_EQ(keys_of(after), keys_of(before));
  const std::vector<std::string> table_after = table();
  ASSERT_EQ(table_after.size(), table_before.size());
  std::size_t same_rows = 0;
  for (std::size_t k = 0; k < table_after.size(); ++k)
    same_rows += table_after[k] == table_before[k] ? 1U : 0U;
  EXPECT_EQ(same_rows, table_before.size() - damaged.size());
  for (const auto& [name, file] : before) {
    const bool is_new = std::find(damaged.begin(), damaged.end(), name) != damaged.end();
    EXPECT_EQ(after.at(name) != file, is_new) << name;
    EXPECT_TRUE(cli::parse_run_file(after.at(name).bytes, 6)) << name;
  }
}

TEST_F(ProgramStudy, RefusesWhatContradictsTheFolder) {
  expect_success(run(tiny_on_host + " --preset quick --most sweep-and-prune=90"));
  const std::map<std::string, File> before = run_files();
  const std::string json_before = read_file(path("s/study.json"));
  const std::vector<std::pair<std::string, std::string>> contradictions = {
      {"--preset paper", "--preset quick;"},
      {"--scenarios free-fall", "--scenarios free-fall,mixed-sizes;"},
      {"--objects 50,80,90", "--objects 50,80;"},
      {"--broadphases bullet-bf,oracle", "--broadphases bullet-bf,sweep-and-prune;"},
      {"--most bullet-bf=70", "--most sweep-and-prune=90;"},
      {"--frames 7", "--frames 6;"},
      {"--repeat 3", "--repeat 2;"},
      {"--seed 2", "--seed 1;"}};
  for (const auto& [asked, there] : contradictions) {
    SCOPED_TRACE(asked);
    const Outcome outcome = run("study --out s " + asked);
    expect_refused(outcome, "'s' holds a study with " + there);
    EXPECT_THAT(outcome.err, HasSubstr("--out"));
  }
  EXPECT_EQ(run_files(), before);
  EXPECT_EQ(read_file(path("s/study.json")), json_before);
  expect_success(
      run("study --out s --preset quick --objects 80,50 --most sweep-and-prune=90 --frames 6 --seed 1"));
  EXPECT_EQ(run_files(), before);
}

TEST_F(ProgramStudy, RefusesNewLimitsAndAFolderThatAnotherStudyHas) {
  expect_success(run(tiny_on_host));
  expect_refused(run("study --out s --most bullet-bf=70"),
                 "'s' holds a study with --most for no broad phase;");
  fs::remove(path("s/runs/free-fall-50-bullet-bf-1.csv"));
  const std::map<std::string, File> before = run_files();
  {
    const auto lock = lock_folder(path("s"));
    expect_refused(run("study --out s"), "another study is running in 's'; wait for its end");
    EXPECT_EQ(run_files(), before);
  }
  expect_success(run("study --out s"));
  EXPECT_EQ(run_files().size(), before.size() + 1);
}

NOT_IN(sanitizers, "takes long");
TEST_F(ProgramStudy, LimitsOfThePresetStayButForThoseThatAreGiven) {
  const std::string few = "study --preset large --scenarios free-fall --objects 5,6 --frames 2 --repeat 1 ";
  const auto limits_in = [&](const std::string& folder) {
    return json::parse(read_file(path(folder + "/study.json")))["limits"];
  };
  expect_success(run(few + "--out a"));
  const json own = limits_in("a");
  ASSERT_EQ(own.size(), 1U);
  EXPECT_EQ(own[0]["broadphase"], "gpu-bf");
  expect_success(run(few + "--most tiles=5 --out b"));
  EXPECT_EQ(limits_in("b")[0], own[0]);
  EXPECT_EQ(limits_in("b")[1], json({{"broadphase", "tiles"}, {"objects", 5}, {"why", ""}}));
  expect_success(run(few + "--most gpu-bf=5 --out c"));
  EXPECT_EQ(limits_in("c"), json::array({{{"broadphase", "gpu-bf"}, {"objects", 5}, {"why", ""}}}));
  // The command in the document makes the same document again.
  std::string command = json::parse(read_file(path("a/study.json")))["command"];
  command = command.substr(8, command.size() - 8 - 1) + "d";
  expect_success(run(command));
  for (const std::string key : {"limits", "cut", "broadphases"}) {
    EXPECT_EQ(json::parse(read_file(path("d/study.json")))[key],
              json::parse(read_file(path("a/study.json")))[key]);
  }
}

TEST_F(ProgramStudy, RefusesTimesOfAnotherHostOrBuildAndDamagedDocuments) {
  expect_success(run(tiny_on_host));
  const json study = json::parse(read_file(path("s/study.json")));
  const auto refuses = [&](const json& document, const std::string& message) {
    write_file(path("s/study.json"), document.dump());
    expect_refused(run("study --out s"), message);
  };
  json other = study;
  other["host"]["cpu"] = "Abacus";
  refuses(other, R"(cpu "Abacus", but here it is ")");
  other = study;
  other["versions"]["broadcl"] = "0.0.1";
  refuses(other, "broadcl \"0.0.1\"");
  other = study;
  other["format"] = 2;
  refuses(other, "another version");
  other = study;
  other.erase("frames");
  refuses(other, "damaged");
  for (const auto& [key, value] : {std::pair("frames", json(-1)),
                                   {"frames", json(2.5)},
                                   {"repeat", json(0)},
                                   {"objects", json::array()},
                                   {"objects", json::array({-1})},
                                   {"scenarios", json::array()},
                                   {"scenarios", json::array({"free-fall", "../free-fall"})},
                                   {"versions", json::object()}}) {
    other = study;
    other[key] = value;
    refuses(other, "'s/study.json' is damaged");
  }
  write_file(path("s/study.json"), study.dump());
  for (const std::string name : {"study.json", "study.csv", "runs/new.csv"}) {
    expect_refused(run("study --out s --frames-csv s/" + name), "names a file of the study itself");
  }
  write_file(path("s/study.json"), study.dump().substr(0, 100));
  expect_refused(run("study --out s"), "'s/study.json' is damaged");
  fs::remove(path("s/study.json"));
  fs::create_directory(path("s/study.json"));
  expect_refused(run("study --out s"), "'s/study.json' is a directory");
  fs::remove(path("s/study.json"));
  expect_refused(run("study --out s"), "'s' has runs but no study.json");
}

NOT_IN(sanitizers, "compiles the kernels of several devices");
TEST_F(ProgramStudy, AddsAnotherDevice) {
  const std::string both = "RUSTICL_ENABLE=llvmpipe";
  const json devices = json::parse(run("devices --json", both).out);
  const auto is_other = [&](const json& device) {
    return device["platform"] != devices[0]["platform"] || device["name"] != devices[0]["name"];
  };
  const auto other = std::find_if(devices.begin(), devices.end(), is_other);
  if (other == devices.end()) GTEST_SKIP() << "there is no second device";
  const std::string second = (*other)["id"];
  const std::string small =
      "study --scenarios agitated --objects 50 --frames 3 --repeat 1 --broadphases bullet-bf,gpu-bf --out s";
  expect_success(run(small + " --devices " + devices[0]["id"].get<std::string>(), both));
  const std::map<std::string, File> before = run_files();
  ASSERT_EQ(before.size(), 2U);
  const Outcome outcome = run("study --out s --devices " + second, both);
  expect_success(outcome);
  const std::map<std::string, File> after = run_files();
  EXPECT_EQ(after.size(), 3U);
  for (const auto& [name, file] : before) EXPECT_EQ(after.at(name), file) << name;
  EXPECT_EQ(table().size(), 4U);
  const json study = json::parse(read_file(path("s/study.json")));
  ASSERT_EQ(study["devices"].size(), 2U);
  EXPECT_EQ(study["devices"][1]["id"], second);
  EXPECT_THAT(outcome.out, HasSubstr(study["devices"][0]["label"].get<std::string>()));
  EXPECT_THAT(outcome.out, HasSubstr(study["devices"][1]["label"].get<std::string>()));

  fs::remove(path("s/runs/" + keys_of(after)[2]));
  json edited = study;
  for (json& device : edited["devices"]) device["driver_version"] = "0.1";
  write_file(path("s/study.json"), edited.dump());
  expect_refused(run("study --out s", both), "with the driver '0.1'");
  edited["devices"][0]["label"] = "ACME / Rocket";
  write_file(path("s/study.json"), edited.dump());
  expect_refused(run("study --out s", both), "'ACME / Rocket', which is not among the devices now");
}

TEST_F(ProgramStudy, GoesOnWithTheOthersIfARunFails) {
  const Outcome outcome = run(tiny, "BROADCL_KERNEL_DIR=/nowhere");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.out, HasSubstr("8 of 16 runs done"));
  EXPECT_THAT(outcome.err, HasSubstr("8 of 16 runs failed"));
  EXPECT_EQ(lines_of(outcome.err).size(), 8U + 1 + 8) << outcome.err;
  EXPECT_THAT(outcome.err,
              HasSubstr("free-fall, 80 objects, tiles on " + select_device().label() + ", repetition 2: "));
  EXPECT_EQ(table().size(), 9U);
  const std::map<std::string, File> before = run_files();
  EXPECT_EQ(before.size(), 8U);
  expect_success(run(tiny));
  const std::map<std::string, File> after = run_files();
  EXPECT_EQ(after.size(), 16U);
  for (const auto& [name, file] : before) EXPECT_EQ(after.at(name), file) << name;
}

TEST_F(ProgramStudy, HostBroadPhasesNeedNoDevice) {
  expect_success(run(tiny_on_host, "OCL_ICD_VENDORS=/nonexistent"));
  EXPECT_EQ(json::parse(read_file(path("s/study.json")))["devices"], json::array());
}

TEST_F(ProgramStudy, AutoStaysOnTheHostIfItHasNoDevice) {
  const std::string small = "study --scenarios free-fall --objects 50 --frames 3 --repeat 1 --broadphases ";
  const std::string on_host = "free-fall-50-auto-1.csv";
  const std::string no_device = "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent";
  if (run("devices", no_device).exit_code == 0) {
    GTEST_SKIP() << "this OpenCL loader ignores OCL_ICD_VENDORS, so devices cannot be hidden";
  }
  expect_success(run(small + "auto,auto+culling --out s", no_device));
  ASSERT_THAT(keys_of(run_files()),
              testing::UnorderedElementsAre(on_host, "free-fall-50-auto+culling-1.csv"));
  expect_success(run("study --out s", no_device));
  expect_refused(run("study --out s --devices 0:0"), "'s' holds a study with auto on the host");

  fs::remove_all(path("s"));
  if (select_device({}, devices()).type != DeviceType::cpu) return;
  expect_success(run(small + "tiles,auto --out s", "BROADCL_DEVICE="));
  EXPECT_EQ(run_files().size(), 2U);
  EXPECT_EQ(run_files().count(on_host), 1U);
  const json study = json::parse(read_file(path("s/study.json")));
  EXPECT_THAT(study["command"], testing::Not(HasSubstr("--devices")));
}

TEST_F(ProgramStudy, BadArgumentsAreRefusedAndLeaveNothing) {
  const std::vector<std::string> before = files();
  const Device device = select_device();
  const std::vector<std::pair<std::string, std::string>> bad = {
      {"--frobnicate", "--frobnicate"},
      {"--preset slow", "no preset is named 'slow'; the presets are: paper, quick, large"},
      {"--preset 'a\nb'", "'a b'"},
      {"--scenarios free-fall,frobnicate", "'frobnicate'; the scenarios are: free-fall"},
      {"--scenarios ''", "--scenarios"},
      {"--scenarios free-fall,", "--scenarios: an element of the list is empty"},
      {"--scenarios free-fall,free-fall", "--scenarios: 'free-fall' is given twice"},
      {"--broadphases frobnicate", "'frobnicate'; the broad phases are: bullet-bf"},
      {"--broadphases ,tiles", "--broadphases: an element"},
      {"--objects 50,-5", "--objects: '-5' is not a whole number from 1 to 1000000"},
      {"--objects 50,5e1", "--objects: '5e1'"},
      {"--objects 0", "--objects: '0'"},
      {"--objects 50,050", "--objects: '050' is given twice"},
      {"--most bullet-bf", "--most: 'bullet-bf' is not NAME=N, a broad phase and a number of objects"},
      {"--most bullet-bf=50,bullet-bf=60", "--most: 'bullet-bf' is given twice"},
      {"--most bullet-bf=0", "--most: '0' is not a whole number from 1"},
      {"--most frobnicate=5", "--most: 'frobnicate' is not one of the measured broad phases: bullet-bf,"},
      {"--frames 1", "--frames: '1' is not a whole number from 2 to"},
      {"--repeat 0", "--repeat: '0'"},
      {"--seed -1", "--seed: '-1'"},
      {"--devices frobnicate", "'frobnicate'"},
      {"--devices frobnicate --broadphases bullet-bf", "'frobnicate'"},
      {"--devices '" + device.id() + "," + device.label() + "'",
       "--devices: '" + device.label() + "' is '" + device.label() + "', which is given already"},
      {"--out four.npy", "'four.npy'"},
      {"--out ''", "--out: name a folder"},
      {"--out /proc/nowhere", "'/proc/nowhere'"},
      {"--out four.npy/s", "'four.npy/s'"},
      {"--frames-csv folder", "'folder' is a directory"},
      {"--frames-csv missing/frames.csv", "missing/frames.csv"}};
  for (const auto& [arguments, message] : bad) {
    SCOPED_TRACE(arguments);
    expect_refused(run("study " + arguments), message);
    EXPECT_EQ(files(), before);
  }
}

}  // namespace
}  // namespace broadcl::test
