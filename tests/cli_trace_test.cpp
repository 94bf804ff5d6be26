// `broadcl simulate` with --trace and --profile: what they report about time.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <broadcl/device.hpp>

#include "device_stages.hpp"
#include "program.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

using nlohmann::json;

/// A complete event of a trace, in whole nanoseconds.
struct TraceEvent {
  std::string name;
  std::int64_t begin;
  std::int64_t end;
  std::size_t frame;

  [[nodiscard]] bool within(const TraceEvent& other) const {
    return begin >= other.begin && end <= other.end;
  }
};

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

/// On one thread, an event lies either inside another one or beside it, and comes after the events that
/// contain it.
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

class ProgramTrace : public Program, public testing::WithParamInterface<std::string> {
 protected:
  static constexpr std::size_t frames = 8;

  ProgramTrace() {
    expect_success(
        run("simulate --objects 60 --frames 8 --csv run.csv --trace trace.json --broadphase " + GetParam()));
    trace_ = json::parse(read_file(path("trace.json")));
    host_ = thread_events(trace_, "host");
    device_ = thread_events(trace_, "device");
    csv_ = csv_rows(path("run.csv"));
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

TEST_P(ProgramTrace, ReportsWhatWasRun) {
  EXPECT_EQ(trace_["displayTimeUnit"], "ms");
  const json& facts = trace_["otherData"];
  EXPECT_EQ(facts["config"]["scenario"], "mixed-sizes");
  EXPECT_EQ(facts["config"]["objects"], 60);
  EXPECT_EQ(facts["config"]["broadphase"], GetParam());
  EXPECT_EQ("broadcl " + facts["versions"]["broadcl"].get<std::string>() + "\n", run("--version").out);
  if (GetParam().starts_with("bullet-")) {
    EXPECT_TRUE(facts["device"].is_null());
  } else {
    EXPECT_EQ(facts["device"]["id"], select_device().id());
  }
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramTrace, testing::Values("bullet-bvh", "gpu-bf", "brute-force"),
                         named_by_parameter);

class ProgramStages : public ProgramTrace {};

TEST_P(ProgramStages, LieInTheBroadPhaseOfTheirFrame) {
  for (std::size_t frame = 0; frame < frames; ++frame) {
    const TraceEvent broad_phase = find_event(host_, "broad phase", frame);
    std::int64_t sum = 0;
    int stages = 0;
    for (const TraceEvent& event : host_) {
      if (event.frame != frame || event.name == "broad phase" || !event.within(broad_phase)) continue;
      ++stages;
      sum += event.end - event.begin;
    }
    EXPECT_GE(stages, 3);
    EXPECT_GT(sum, 0);
    EXPECT_LE(sum, broad_phase.end - broad_phase.begin);
  }
}

TEST_P(ProgramStages, OfTheDeviceFollowOneAnother) {
  for (std::size_t frame = 1; frame < frames; ++frame) {
    std::vector<TraceEvent> events;
    std::copy_if(device_.begin(), device_.end(), std::back_inserter(events),
                 [&](const TraceEvent& event) { return event.frame == frame; });
    ASSERT_GE(events.size(), 2U);
    if (device_clock_ticks()) {
      for (std::size_t k = 1; k < events.size(); ++k)
        EXPECT_LE(events[k - 1].end, events[k].begin) << events[k].name;
    }
    // The clocks of host and device differ, but a command neither starts before its update nor outlasts its
    // broad phase.
    const TraceEvent broad_phase = find_event(host_, "broad phase", frame);
    EXPECT_GE(events.front().begin, broad_phase.begin);
    EXPECT_LE(events.back().end, broad_phase.end);
  }
}

INSTANTIATE_TEST_SUITE_P(BroadPhases, ProgramStages, testing::Values("gpu-bf", "brute-force"),
                         named_by_parameter);

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

}  // namespace
}  // namespace broadcl::test
