// `broadcl simulate`, run as users run it.
#include <algorithm>
#include <cstddef>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "cli/progress_bar.hpp"
#include "cli/simulation.hpp"
#include "cli/statistics.hpp"

#include "expect_error.hpp"
#include "failing_opencl.hpp"
#include "program.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

using nlohmann::json;

class ProgramSimulate : public Program, public testing::WithParamInterface<std::string> {};

TEST_P(ProgramSimulate, VerifiesAndReports) {
  const Outcome outcome =
      run("simulate --scenario mixed-sizes --objects 40 --frames 12 --seed 7 --verify --csv run.csv "
          "--json run.json --broadphase " +
          GetParam());
  expect_success(outcome);
  for (const std::string part :
       {"mixed-sizes, 40 cubes, 12 frames, seed 7", "\nupdate ", "\nbroad phase ", "\ntotal ", "\npairs ",
        "\ndevice ", "\nverified ", "\nUpdate: updateAabbs(), "}) {
    EXPECT_NE(outcome.out.find(part), std::string::npos) << part << " is not in\n" << outcome.out;
  }

  const std::vector<CsvRow> rows = csv_rows(path("run.csv"));
  ASSERT_EQ(rows.size(), 12U);
  double sum_of_totals = 0;
  double sum_of_cpu_totals = 0;
  for (const CsvRow& row : rows) {
    EXPECT_GE(row.total, row.update + row.broad_phase);
    if (&row == &rows.front()) continue;
    sum_of_totals += row.total;
    sum_of_cpu_totals += row.total_cpu;
  }
  EXPECT_GT(sum_of_cpu_totals, 0);

  const json summary = json::parse(read_file(path("run.json")));
  const json config = {
      {"scenario", "mixed-sizes"}, {"objects", 40}, {"shape", "cube"}, {"seed", 7}, {"frames", 12},
      {"broadphase", GetParam()},  {"device", ""}};
  EXPECT_EQ(summary["config"], config);
  EXPECT_EQ("broadcl " + summary["versions"]["broadcl"].get<std::string>() + "\n", run("--version").out);
  EXPECT_EQ(summary["device"].is_null(), GetParam().starts_with("bullet-"));
  EXPECT_NEAR(summary["milliseconds"]["total"]["mean"].get<double>(), sum_of_totals / 11, 1e-5);
  EXPECT_NEAR(summary["cpu_milliseconds"]["total"]["mean"].get<double>(), sum_of_cpu_totals / 11, 1e-5);
  for (const std::string stage : {"update", "broad_phase", "total"}) {
    const json& times = summary["milliseconds"][stage];
    EXPECT_GE(times["p95"].get<double>(), times["median"].get<double>());
    EXPECT_GT(times["first_frame"].get<double>(), 0);
  }
  EXPECT_EQ(summary["pairs"]["last"], rows.back().pairs);
  EXPECT_EQ(summary["verify"]["equal"], true);
  EXPECT_EQ(summary["verify"]["missing_pairs"], 0);
  EXPECT_TRUE(summary["verify"]["first_wrong_frame"].is_null());
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramSimulate,
                         testing::Values("bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf", "tiles+culling"),
                         named_by_parameter);

TEST_F(Program, SimulateHasTheSamePairsInEveryRun) {
  std::vector<std::vector<std::size_t>> pairs;
  for (int i = 0; i < 2; ++i) {
    expect_success(run("simulate --scenario agitated --objects 60 --frames 20 --spheres --csv run.csv"));
    pairs.push_back(pairs_in(path("run.csv")));
    EXPECT_EQ(pairs.back().size(), 20U);
  }
  EXPECT_EQ(pairs[0], pairs[1]);
}

TEST_F(Program, SimulateTimesTheOnlyFrameIfThereIsOne) {
  const Outcome outcome = run("simulate --objects 5 --frames 1 --json run.json");
  expect_success(outcome);
  EXPECT_NE(outcome.out.find("\nFrame 0, the only one, includes the warm-up.\n"), std::string::npos);
  const json times = json::parse(read_file(path("run.json")))["milliseconds"]["total"];
  for (const std::string column : {"mean", "median", "p95"}) EXPECT_EQ(times[column], times["first_frame"]);
}

TEST_F(Program, SimulateComparesBroadPhasesWithTheFirst) {
  const Outcome outcome =
      run("simulate --objects 40 --frames 12 --broadphase bullet-bf,sweep-and-prune,bullet-bvh --verify "
          "--svg times.svg");
  expect_success(outcome);
  std::vector<std::string> names;
  for (const std::string& line : lines_of(outcome.out)) {
    std::istringstream stream(line);
    std::string name;
    double search = 0;
    double search_ratio = 0;
    double total = 0;
    double total_ratio = 0;
    std::string device;
    if (!(stream >> name >> search >> search_ratio >> total >> total_ratio >> device)) continue;
    names.push_back(name);
    EXPECT_GT(search, 0);
    EXPECT_GT(total, search);
    if (names.size() == 1) {
      EXPECT_EQ(std::pair(search_ratio, total_ratio), std::pair(1.0, 1.0));
    }
    EXPECT_EQ(device, "host");
  }
  EXPECT_EQ(names, (std::vector<std::string>{"bullet-bf", "sweep-and-prune", "bullet-bvh"}));
  for (const std::string part :
       {"mixed-sizes, 40 cubes, 12 frames, seed 1\n", "\nUpdate and broad phase ",
        "\nbullet-bf     every frame has exactly", "\nbullet-bvh    no frame misses"}) {
    EXPECT_NE(outcome.out.find(part), std::string::npos) << part << " is not in\n" << outcome.out;
  }
  const std::string svg = read_file(path("times.svg"));
  EXPECT_EQ(std::ranges::count(svg, '<'), std::ranges::count(svg, '>'));
  for (const std::string part :
       {">bullet-bf<", ">sweep-and-prune<", ">bullet-bvh<", " ms<", "×<", "40 cubes"}) {
    EXPECT_NE(svg.find(part), std::string::npos) << part << " is not in\n" << svg;
  }
}

TEST_F(Program, SimulateReportsStagesOnlyWithProfile) {
  const Outcome outcome = run("simulate --objects 5 --frames 2 --json run.json");
  expect_success(outcome);
  EXPECT_EQ(outcome.out.find("stages"), std::string::npos) << outcome.out;
  EXPECT_TRUE(json::parse(read_file(path("run.json")))["stages"].is_null());
}

class ProgramStages : public Program, public testing::WithParamInterface<std::string> {};

TEST_P(ProgramStages, AreReportedWithProfile) {
  const Outcome outcome =
      run("simulate --objects 60 --frames 8 --profile --json run.json --broadphase " + GetParam());
  expect_success(outcome);
  const json summary = json::parse(read_file(path("run.json")));
  const double broad_phase = summary["milliseconds"]["broad_phase"]["mean"];
  double sum = 0;
  std::vector<std::string> names;
  int on_device = 0;
  const std::size_t table = outcome.out.find("\nstages of the broad phase ");
  ASSERT_NE(table, std::string::npos) << outcome.out;
  std::size_t offset = table;
  for (const json& stage : summary["stages"]) {
    names.push_back(stage["name"]);
    offset = outcome.out.find("\n" + names.back() + " ", offset + 1);
    ASSERT_NE(offset, std::string::npos) << names.back() << " is not in its row in\n" << outcome.out;
    std::istringstream row(outcome.out.substr(offset + 1 + names.back().size()));
    for (const std::string side : {"host", "device"}) {
      for (const std::string column : {"mean", "median", "p95"}) {
        double shown = -1;
        row >> shown;
        EXPECT_NEAR(shown, stage[side + "_milliseconds"][column].get<double>(), 1e-4) << names.back();
      }
    }
    const double mean = stage["host_milliseconds"]["mean"];
    EXPECT_NEAR(stage["share_of_broad_phase"].get<double>(), mean / broad_phase, 1e-9);
    const json& times = stage["device_milliseconds"];  // the mean leaves out the first frame
    on_device += times["mean"].get<double>() > 0 || times["first_frame"].get<double>() > 0 ? 1 : 0;
    sum += mean;
  }
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
  EXPECT_GE(on_device, 2);
  EXPECT_LT(static_cast<std::size_t>(on_device), names.size()) << "the host waits";
  EXPECT_LE(sum, broad_phase);
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramStages, testing::Values("gpu-bf", "brute-force"),
                         named_by_parameter);

TEST_F(Program, SimulateSaysThatABroadPhaseHasNoStages) {
  for (const std::string broadphase : {"bullet-bf", "bullet-sap", "bullet-bvh", "oracle"}) {
    const Outcome outcome =
        run("simulate --objects 5 --frames 2 --profile --json run.json --broadphase " + broadphase);
    expect_success(outcome);
    EXPECT_EQ(lines_of(outcome.out).back(),
              "The broad phase " + broadphase + " ran on the host, where no stages are measured.");
    EXPECT_EQ(json::parse(read_file(path("run.json")))["stages"], json::array());
  }
}

TEST(Simulate, EndsWhenTheDeviceFails) {
  cli::SimulationConfig config;
  config.scenario.objects = 40;
  config.frames = 5;
  config.broadphase = "tiles";
  int frames = 0;
  std::optional<FailingOpenCl> failing;
  const std::string error = error_of([&] {
    (void)cli::simulate(config, [&] {
      if (++frames == 2) failing.emplace(0, 1'000'000);
    });
  });
  EXPECT_TRUE(error.starts_with("stopped in frame 2, when the broad phase reported: ")) << error;
  EXPECT_EQ(frames, 2);
}

TEST(Summary, LeavesOutFrame0UnlessItIsTheOnlyOne) {
  EXPECT_EQ(cli::without_warm_up({98, 3, 4}), (std::vector<double>{3, 4}));
  EXPECT_EQ(cli::without_warm_up({98}), (std::vector<double>{98}));
}

TEST(ProgressBar, ExpectsNothingOfTheFirstStep) {
  EXPECT_EQ(cli::seconds_left(1, 2048, 0), std::nullopt);
  EXPECT_EQ(cli::seconds_left(2, 2048, 0.5), 1023);
  EXPECT_EQ(cli::seconds_left(1025, 2049, 10), 10);
  EXPECT_EQ(cli::seconds_left(2048, 2048, 10), 0);
}

TEST(Summary, InterpolatesBetweenNeighbours) {
  const cli::Summary odd = cli::summarize({9, 1, 2});
  EXPECT_DOUBLE_EQ(odd.mean, 4);
  EXPECT_DOUBLE_EQ(odd.median, 2);
  EXPECT_DOUBLE_EQ(odd.p95, 8.3);
  const cli::Summary even = cli::summarize({4, 3, 2, 1});
  EXPECT_DOUBLE_EQ(even.median, 2.5);
  const cli::Summary one = cli::summarize({5});
  EXPECT_DOUBLE_EQ(one.mean, 5);
  EXPECT_DOUBLE_EQ(one.median, 5);
  EXPECT_DOUBLE_EQ(one.p95, 5);
}

}  // namespace
}  // namespace broadcl::test
