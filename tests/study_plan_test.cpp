// What a study measures, in which order and how long that takes, and how the file of a run is read.
#include "cli/study_plan.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <broadcl/error.hpp>
#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "cli/study_cost.hpp"
#include "cli/study_document.hpp"
#include "cli/study_folder.hpp"
#include "cli/study_run_file.hpp"
#include "cli/text.hpp"
#include "environment.hpp"
#include "expect_error.hpp"

namespace broadcl::cli {
namespace {

using test::error_of;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::array<std::string, 2> two_devices = {"ACME / Rocket (TM) 9", "ACME / Rocket 10"};

StudySettings small_settings() {
  return {.preset = "quick",
          .scenarios = {"mixed-sizes", "free-fall"},
          .objects = {80, 50},
          .broadphases = {"bullet-bf", "tiles", "sweep-and-prune"},
          .frames = 6,
          .repeat = 2,
          .limits = {},
          .left_out = {}};
}

std::vector<std::string> files_of(const std::vector<StudyRun>& runs) {
  std::vector<std::string> names(runs.size());
  std::transform(runs.begin(), runs.end(), names.begin(), file_name);
  return names;
}

TEST(StudyPlan, HasEveryCombinationOnceInTheOrderOfTheSettings) {
  const std::vector<StudyRun> runs = planned_runs(small_settings(), two_devices);
  const std::vector<std::string> files = files_of(runs);
  const std::vector<std::string> first(files.begin(), files.begin() + 9);
  EXPECT_THAT(
      first,
      ElementsAre("mixed-sizes-80-bullet-bf-1.csv", "mixed-sizes-80-bullet-bf-2.csv",
                  "mixed-sizes-80-tiles-acme-rocket-tm-9-1.csv",
                  "mixed-sizes-80-tiles-acme-rocket-tm-9-2.csv", "mixed-sizes-80-tiles-acme-rocket-10-1.csv",
                  "mixed-sizes-80-tiles-acme-rocket-10-2.csv", "mixed-sizes-80-sweep-and-prune-1.csv",
                  "mixed-sizes-80-sweep-and-prune-2.csv", "mixed-sizes-50-bullet-bf-1.csv"));
  EXPECT_EQ(files.size(), 2U * 2 * (1 + 2 + 1) * 2);
  EXPECT_EQ(std::set<std::string>(files.begin(), files.end()).size(), files.size());
}

TEST(StudyPlan, WithoutDevicesHasWhatTheHostCanDo) {
  EXPECT_EQ(planned_runs(small_settings(), {}).size(), 2U * 2 * 2 * 2);
}

TEST(StudyPlan, AutoMayStayOnTheHost) {
  StudySettings settings = small_settings();
  settings.broadphases = {"tiles", "auto", "auto+culling"};
  EXPECT_EQ(planned_runs(settings, two_devices).size(), 2U * 2 * (2 + 2 + 2) * 2);
  settings.auto_on_host = true;
  EXPECT_EQ(planned_runs(settings, two_devices).size(), 2U * 2 * (2 + 1 + 1) * 2);
}

TEST(StudyPlan, LimitsCutWhatIsBeyondThem) {
  StudySettings settings = small_settings();
  settings.left_out = {"why not"};
  settings.limits = {{.broadphase = "bullet-bf", .objects = 50, .why = "slow"},
                     {.broadphase = "tiles", .objects = 80, .why = "never"}};
  for (const StudyRun& run : planned_runs(settings, two_devices)) {
    EXPECT_TRUE(run.broadphase != "bullet-bf" || run.objects == 50) << file_name(run);
  }
  EXPECT_EQ(planned_runs(settings, two_devices).size(), 2U * (2 * (1 + 2 + 1) - 1) * 2);
  settings.limits.push_back({.broadphase = "sweep-and-prune", .objects = 60, .why = {}});
  const std::vector<std::string> cut = cut_of(settings);
  EXPECT_THAT(std::vector<std::string>(cut.begin(), cut.begin() + 3),
              ElementsAre("why not", "bullet-bf at more than 50 objects: slow",
                          "sweep-and-prune at more than 60 objects"));
  EXPECT_THAT(cut, testing::Not(testing::Contains(HasSubstr("never"))));
  EXPECT_THAT(limit_texts(settings.limits), ElementsAre("bullet-bf=50", "tiles=80", "sweep-and-prune=60"));
}

TEST(StudyPlan, SaysWhatOfThePresetIsMissing) {
  StudySettings settings = find_study_preset("paper");
  settings.scenarios = {"agitated", "streaming", "mixed-sizes"};
  settings.objects = {500, 1250, 2000, 2750, 9000};
  settings.broadphases = {"tiles", "bullet-sap", "bullet-bvh", "gpu-bf", "brute-force", "auto"};
  settings.frames = 256;
  settings.repeat = 3;
  EXPECT_THAT(cut_of(settings),
              ElementsAre("scenarios: free-fall, rolling-gravity", "numbers of objects: 3,500",
                          "broad phases: bullet-bf, auto+culling", "frames beyond 256 of 2,048",
                          "repetitions beyond 3 of 5"));
  settings = find_study_preset("paper");
  settings.frames = 4096;
  settings.repeat = 6;
  EXPECT_THAT(cut_of(settings), IsEmpty());
}

TEST(StudyPlan, OrderIsRandomAndTheSameForTheSameSeed) {
  const std::vector<StudyRun> sorted = planned_runs(small_settings(), two_devices);
  const std::vector<std::string> order = files_of(in_random_order(sorted, 1));
  EXPECT_NE(order, files_of(sorted));
  EXPECT_EQ(order, files_of(in_random_order(sorted, 1)));
  EXPECT_NE(order, files_of(in_random_order(sorted, 2)));
  EXPECT_THAT(order, testing::UnorderedElementsAreArray(files_of(sorted)));
}

TEST(StudyPlan, PaperIsThePapersSetUp) {
  const StudySettings paper = find_study_preset("paper");
  EXPECT_THAT(paper.scenarios, ElementsAre("free-fall", "agitated", "rolling-gravity", "mixed-sizes"));
  EXPECT_THAT(paper.objects, ElementsAre(500, 1250, 2000, 2750, 3500));
  EXPECT_THAT(paper.broadphases, ElementsAre("bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf", "brute-force",
                                             "tiles", "auto", "auto+culling"));
  EXPECT_EQ(paper.frames, 2048U);
  EXPECT_EQ(paper.repeat, 5U);
  EXPECT_THAT(cut_of(paper), IsEmpty());
}

TEST(StudyPlan, LargeSaysWhatItLeavesOut) {
  const StudySettings large = find_study_preset("large");
  EXPECT_THAT(cut_of(large), ElementsAre(HasSubstr("bullet-bf"), HasSubstr("bullet-sap"),
                                         HasSubstr("gpu-bf at more than 8,000 objects")));
  for (const StudyRun& run : planned_runs(large, two_devices)) {
    EXPECT_TRUE(run.broadphase != "gpu-bf" || run.objects <= 8000) << file_name(run);
  }
}

TEST(StudyPlan, UnknownPresetIsAnErrorThatListsThem) {
  EXPECT_EQ(error_of([] { (void)find_study_preset("slow"); }),
            "no preset is named 'slow'; the presets are: paper, quick, large");
}

TEST(StudyPlan, SlugsAreFitForFileNames) {
  EXPECT_EQ(slug("Portable Computing Language / pthread-AMD EPYC"),
            "portable-computing-language-pthread-amd-epyc");
  EXPECT_EQ(slug("(R)../\xc3\xa9 x "), "r-x");
  EXPECT_EQ(slug("//"), "device");
}

TEST(StudyCost, LearnsFromWhatIsMostAlike) {
  const StudyRun tiles = {"free-fall", 500, "tiles", "A", 1};
  const StudyRun elsewhere = {"free-fall", 500, "tiles", "B", 1};
  const StudyRun larger = {"free-fall", 1000, "tiles", "A", 1};
  StudyCost cost(100);
  const double guess = cost.expected(tiles);
  const double guess_larger = cost.expected(larger);
  EXPECT_GT(guess, 0);
  EXPECT_GT(guess_larger, guess);
  cost.add(tiles, 3 * guess);
  cost.add(tiles, 5 * guess);
  EXPECT_DOUBLE_EQ(cost.expected(tiles), 4 * guess);
  EXPECT_DOUBLE_EQ(cost.expected(larger), 4 * guess_larger);
  EXPECT_DOUBLE_EQ(cost.expected(elsewhere), 4 * guess);
  cost.add(elsewhere, guess);
  EXPECT_DOUBLE_EQ(cost.expected(elsewhere), guess);
  EXPECT_DOUBLE_EQ(cost.expected(larger), 4 * guess_larger);
}

const std::string header = "frame,update_ms,broad_phase_ms,total_ms,pairs\n";
const std::string three_frames = header + "0,1,2,9,5\n1,0.5,1,2,7\n2,0.25,3,4,8\n";

TEST(RunFile, IsSummarisedWithoutTheWarmUp) {
  const auto frames = parse_run_file(three_frames, 3);
  ASSERT_TRUE(frames);
  EXPECT_THAT(frames->pairs, ElementsAre(5, 7, 8));
  const RunSummary summary = summarize_run(*frames);
  EXPECT_DOUBLE_EQ(summary.update.mean, 0.375);
  EXPECT_DOUBLE_EQ(summary.broad_phase.median, 2);
  EXPECT_DOUBLE_EQ(summary.total.p95, 3.9);
  EXPECT_DOUBLE_EQ(summary.total_sum, 6);
  EXPECT_DOUBLE_EQ(summary.pairs_mean, 7.5);
  EXPECT_EQ(summary.pairs_last, 8U);
  EXPECT_DOUBLE_EQ(summary.first_frame_total, 9);
}

TEST(RunFile, WhatIsNotWholeIsNotRead) {
  EXPECT_FALSE(parse_run_file(three_frames, 2));
  EXPECT_FALSE(parse_run_file(three_frames, 4));
  for (std::size_t size = 0; size < three_frames.size(); ++size) {
    EXPECT_FALSE(parse_run_file(three_frames.substr(0, size), 3)) << size;
  }
  for (const std::string row :
       {"2,0.25,3,4,8", "1,0.25,3,4", "1,0.25,3,4,-8", "1,0.25,3,2,8", "1,-1,3,4,8", "1,nan,3,4,8",
        "1,0.25,3,inf,8", "1,0.25,3,4,8,9", "1;0.25;3;4;8", "", "1, 0.25,3,4,8"}) {
    std::string text = header;
    text.append("0,1,2,9,5\n").append(row).append("\n");
    EXPECT_FALSE(parse_run_file(text, 2)) << row;
  }
}

TEST(Text, FieldsOfCsvAreQuotedIfNecessary) {
  EXPECT_EQ(csv_field(""), "");
  EXPECT_EQ(csv_field("ACME / Rocket (TM)"), "ACME / Rocket (TM)");
  EXPECT_EQ(csv_field("a, \"b\""), R"("a, ""b""")");
  EXPECT_EQ(csv_field("a\nb"), "\"a\nb\"");
}

TEST(Text, DurationsAndNumbers) {
  EXPECT_EQ(duration_text(0), "0 s");
  EXPECT_EQ(duration_text(119.4), "119 s");
  EXPECT_EQ(duration_text(119.6), "2 min");
  EXPECT_EQ(duration_text(7199), "119 min");
  EXPECT_EQ(duration_text(7260), "2 h 1 min");
  EXPECT_EQ(grouped(0), "0");
  EXPECT_EQ(grouped(999), "999");
  EXPECT_EQ(grouped(1000), "1,000");
  EXPECT_EQ(grouped(1'234'567), "1,234,567");
}

TEST(StudyFolder, IsOfOneStudyAtATime) {
  const test::ScopedFolder folder;
  const nlohmann::ordered_json document = new_document(small_settings());
  StudyFolder study(folder.path());
  ASSERT_FALSE(study.read_document());
  {
    StudyFolder other(folder.path());
    other.lock(nullptr);
    other.write_document(document);
    EXPECT_THAT(error_of([&] { study.lock(nullptr); }), HasSubstr("another study is running"));
  }
  EXPECT_THAT(error_of([&] { study.lock(nullptr); }), HasSubstr("another study has changed"));
  EXPECT_EQ(study.read_document(), document);
  StudyFolder(folder.path()).lock(document);
  study.lock(document);
}

}  // namespace
}  // namespace broadcl::cli
