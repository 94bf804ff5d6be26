#include <LinearMath/btScalar.h>

#include <broadcl/version.h>
#include <algorithm>
#include <cstddef>
#include <span>
#include <string_view>
#include <utility>

#include "cli/json.hpp"
#include "cli/simulation.hpp"
#include "cli/statistics.hpp"
#include "cli/text.hpp"
#include "scenes/broadphases.hpp"

namespace broadcl::cli {
namespace {

using nlohmann::ordered_json;

double mean_of(const std::vector<std::size_t>& counts) {
  return summarize(std::vector<double>(counts.begin(), counts.end())).mean;
}

/// Of the times of a run.
Summary summary_of(const std::vector<double>& milliseconds) {
  return summarize(without_warm_up(milliseconds));
}

ordered_json json_of(const std::vector<double>& milliseconds) {
  const Summary summary = summary_of(milliseconds);
  return {{"mean", summary.mean},
          {"median", summary.median},
          {"p95", summary.p95},
          {"first_frame", milliseconds.front()}};
}

ordered_json json_of(const Verdict& verdict) {
  ordered_json json = {{"equal", !verdict.first_wrong_frame},
                       {"missing_pairs", verdict.missing},
                       {"extra_pairs", verdict.extra},
                       {"first_wrong_frame", nullptr}};
  if (verdict.first_wrong_frame) json["first_wrong_frame"] = *verdict.first_wrong_frame;
  return json;
}

/// A stage of the broad phase: milliseconds, one value per frame, the sum if a frame has the stage several
/// times.
struct StageTimes {
  std::string_view name;
  std::vector<double> host;
  std::vector<double> device;
};

/// In the order in which the stages first appear.
std::vector<StageTimes> stage_times(const SimulationResult& result) {
  const std::size_t frames = result.stages.size();
  std::vector<StageTimes> all;
  for (std::size_t frame = 0; frame < frames; ++frame) {
    for (const Stage& stage : result.stages[frame]) {
      auto times = std::find_if(all.begin(), all.end(), [&](const auto& t) { return t.name == stage.name; });
      if (times == all.end()) {
        times = all.insert(all.end(), {stage.name, std::vector<double>(frames), std::vector<double>(frames)});
      }
      times->host[frame] += stage.host_seconds * 1e3;
      times->device[frame] += stage.device_seconds * 1e3;
    }
  }
  return all;
}

/// The share of a stage in the wall-clock time of the broad phase.
double share_of(const StageTimes& stage, const SimulationResult& result) {
  return summary_of(stage.host).mean / summary_of(result.broad_phase).mean;
}

ordered_json stages_json(const SimulationResult& result) {
  ordered_json json = ordered_json::array();
  for (const StageTimes& stage : stage_times(result)) {
    json.push_back({{"name", stage.name},
                    {"host_milliseconds", json_of(stage.host)},
                    {"device_milliseconds", json_of(stage.device)},
                    {"share_of_broad_phase", share_of(stage, result)}});
  }
  return json;
}

std::string percent(double share) {
  return right(fixed(share * 100, 1) + " %", 9);
}

std::string stages_table(const SimulationConfig& config, const SimulationResult& result) {
  constexpr int decimals = 4;
  constexpr std::size_t width = 11;
  const std::vector<StageTimes> stages = stage_times(result);
  if (stages.empty())
    return "\nThe broad phase " + config.broadphase + " ran on the host, where no stages are measured.\n";
  std::string text =
      "\nstages of the broad phase      host                               device\n"
      "ms per frame         mean     median        p95       mean     median        p95    share\n";
  double host = 0;
  double device = 0;
  double share = 0;
  for (const StageTimes& stage : stages) {
    text += left(std::string(stage.name), 14);
    for (const std::vector<double>* times : {&stage.host, &stage.device}) {
      const Summary summary = summary_of(*times);
      for (const double value : {summary.mean, summary.median, summary.p95}) {
        text += right(fixed(value, decimals), width);
      }
    }
    text += percent(share_of(stage, result)) + "\n";
    host += summary_of(stage.host).mean;
    device += summary_of(stage.device).mean;
    share += share_of(stage, result);
  }
  const std::string gap(2 * width, ' ');
  return text + left("all stages", 14) + right(fixed(host, decimals), width) + gap +
         right(fixed(device, decimals), width) + gap + percent(share) +
         "\nShare: of the broad phase's wall-clock time; the rest is bookkeeping and Bullet's pair cache.\n";
}

std::string table_row(const std::string& name, const std::vector<double>& milliseconds) {
  constexpr int decimals = 3;
  constexpr std::size_t width = 11;
  const Summary summary = summary_of(milliseconds);
  std::string row = left(name, 14);
  for (const double value : {summary.mean, summary.median, summary.p95, milliseconds.front()}) {
    row += right(fixed(value, decimals), width);
  }
  return row + "\n";
}

std::string text_of(const Verdict& verdict) {
  if (verdict.first_wrong_frame) {
    return "WRONG, first in frame " + std::to_string(*verdict.first_wrong_frame) + "; over all frames, " +
           counted(verdict.missing, "missing pair") + " and " + counted(verdict.extra, "extra pair");
  }
  if (verdict.exact) return "every frame has exactly the pairs of the oracle";
  return "no frame misses a pair of the oracle; " + counted(verdict.extra, "extra pair") +
         " over all frames, which this broad phase may have";
}

/// Mean milliseconds per frame.
struct Means {
  double search;  ///< Update and broad phase.
  double total;
};

Means means_of(const SimulationResult& result) {
  return {.search = summary_of(result.update).mean + summary_of(result.broad_phase).mean,
          .total = summary_of(result.total).mean};
}

ordered_json json_of(const SimulationConfig& config) {
  ordered_json json = {{"scenario", config.scenario.name},
                       {"objects", config.scenario.objects},
                       {"shape", config.scenario.spheres ? "sphere" : "cube"},
                       {"seed", config.scenario.seed},
                       {"frames", config.frames},
                       {"broadphase", config.broadphase},
                       {"device", config.device}};
  if (config.threads > 1) json["threads"] = config.threads;
  return json;
}

std::string document_text(const ordered_json& config, const SimulationResult& result,
                          const ordered_json& stages) {
  ordered_json document = {{"config", config},
                           {"device", result.device ? cli::json_of(*result.device) : ordered_json()},
                           {"versions", versions()}};
  document["milliseconds"] = {{"update", json_of(result.update)},
                              {"broad_phase", json_of(result.broad_phase)},
                              {"total", json_of(result.total)}};
  document["cpu_milliseconds"] = {{"update", json_of(result.cpu.update)},
                                  {"broad_phase", json_of(result.cpu.broad_phase)},
                                  {"total", json_of(result.cpu.total)}};
  document["stages"] = stages;
  document["pairs"] = {{"mean", mean_of(result.pairs)}, {"last", result.pairs.back()}};
  document["verify"] = result.verdict ? json_of(*result.verdict) : ordered_json();
  return cli::text_of(document);
}

}  // namespace

const std::string_view times_of_simulation =
    "Update: updateAabbs(), which computes every object's box and passes it to setAabb(); broad phase:\n"
    "computeOverlappingPairs(); total: the whole stepSimulation().\n";

std::string scenario_line(const SimulationConfig& config) {
  const scenes::Scenario::Config& scenario = config.scenario;
  return "scenario      " + scenario.name + ", " +
         counted(scenario.objects, scenario.spheres ? "sphere" : "cube") + ", " +
         counted(config.frames, "frame") + ", seed " + std::to_string(scenario.seed) +
         (config.threads > 1 ? ", " + counted(config.threads, "thread") : "") + "\n";
}

std::string csv_report(const SimulationResult& result) {
  constexpr int decimals = 6;
  std::string text =
      "frame,update_ms,broad_phase_ms,total_ms,update_cpu_ms,broad_phase_cpu_ms,total_cpu_ms,pairs\n";
  for (std::size_t frame = 0; frame < result.total.size(); ++frame) {
    text += std::to_string(frame) + ",";
    for (const std::vector<double>* times :
         {&result.update, &result.broad_phase, &result.total, &result.cpu.update, &result.cpu.broad_phase,
          &result.cpu.total}) {
      text += fixed((*times)[frame], decimals) + ",";
    }
    text += std::to_string(result.pairs[frame]) + "\n";
  }
  return text;
}

ordered_json versions() {
  const int bullet = btGetVersion();
  return {{"broadcl", BROADCL_VERSION_STRING},
          {"bullet",
           std::to_string(bullet / 100) + (bullet % 100 < 10 ? ".0" : ".") + std::to_string(bullet % 100)}};
}

std::string json_report(const SimulationConfig& config, const SimulationResult& result) {
  return document_text(json_of(config), result, config.profile ? stages_json(result) : ordered_json());
}

std::string json_report_of(const ordered_json& config, const SimulationResult& result) {
  return document_text(config, result, {});
}

std::string table_report(const SimulationConfig& config, const SimulationResult& result) {
  const std::string text =
      table_report_of(scenario_line(config) + "broad phase   " + config.broadphase + "\n", config.broadphase,
                      result) +
      std::string(times_of_simulation);
  return config.profile ? text + stages_table(config, result) : text;
}

std::string comparison_report(const std::string& heading, std::string_view explained,
                              std::span<const std::string> broadphases,
                              std::span<const SimulationResult> results) {
  constexpr int decimals = 3;
  const Means first = means_of(results.front());
  std::string text = heading;
  std::string rows;
  std::string verdicts;
  std::size_t fastest = 0;
  for (std::size_t k = 0; k < results.size(); ++k) {
    const SimulationResult& result = results[k];
    const Means means = means_of(result);
    if (means.search < means_of(results[fastest]).search) fastest = k;
    rows += left(broadphases[k], 20) + right(fixed(means.search, decimals), 23) +
            right(fixed(means.search / first.search, 2), 8) + right(fixed(means.total, decimals), 11) +
            right(fixed(means.total / first.total, 2), 8) + "   " +
            (result.device ? one_line(result.device->label()) : "host") + "\n";
    if (result.verdict) verdicts += left(broadphases[k], 14) + text_of(*result.verdict) + "\n";
  }
  text += "\nmean, ms per frame     update and broad phase   ratio      total   ratio   device\n" + rows +
          verdicts + "\n";
  if (fastest == 0) {
    text += "Update and broad phase are fastest with " + broadphases[0] + ".\n";
  } else {
    text += "Update and broad phase take " + fixed(means_of(results[fastest]).search / first.search, 2) +
            " times as long with " + broadphases[fastest] + " as with " + broadphases[0] + ".\n";
  }
  if (results.front().total.size() > 1) text += "Frame 0, which includes the warm-up, is left out.\n";
  return text + std::string(explained);
}

std::string table_report_of(const std::string& heading, const std::string& broadphase,
                            const SimulationResult& result) {
  std::string text = heading;
  text += "device        " + (result.device ? one_line(result.device->label()) : "host") + "\n";
  text += "pairs         mean " + fixed(mean_of(result.pairs), 1) + ", last " +
          std::to_string(result.pairs.back());
  if (!scenes::find_broadphase(broadphase).exact) {
    text += "; " + broadphase + " also counts boxes that are apart by less than its margin";
  }
  text += "\n";
  if (result.verdict) text += "verified      " + text_of(*result.verdict) + "\n";
  text += "\nms per frame         mean     median        p95    frame 0\n";
  text += table_row("update", result.update);
  text += table_row("broad phase", result.broad_phase);
  text += table_row("total", result.total);
  return text + (result.total.size() == 1
                     ? "Frame 0, the only one, includes the warm-up.\n"
                     : "Frame 0 includes the warm-up; the other columns leave it out.\n");
}

}  // namespace broadcl::cli
