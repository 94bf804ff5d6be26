#include <LinearMath/btScalar.h>

#include "cli/json.hpp"
#include "cli/simulation.hpp"
#include "cli/statistics.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

using nlohmann::ordered_json;

double mean_of(const std::vector<std::size_t>& counts) {
  return summarize(std::vector<double>(counts.begin(), counts.end())).mean;
}

ordered_json json_of(const std::vector<double>& milliseconds) {
  const Summary summary = summarize(milliseconds);
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

std::string table_row(const std::string& name, const std::vector<double>& milliseconds) {
  constexpr int decimals = 3;
  constexpr std::size_t width = 11;
  const Summary summary = summarize(milliseconds);
  std::string row = left(name, 14);
  for (const double value : {summary.mean, summary.median, summary.p95, milliseconds.front()}) {
    row += right(fixed(value, decimals), width);
  }
  return row + "\n";
}

std::string text_of(const Verdict& verdict) {
  if (verdict.first_wrong_frame) {
    return "WRONG, first in frame " + std::to_string(*verdict.first_wrong_frame) + "; over all frames " +
           std::to_string(verdict.missing) + " pairs are missing and " + std::to_string(verdict.extra) +
           " extra";
  }
  if (verdict.exact) return "every frame has exactly the pairs of the oracle";
  return "no frame misses a pair of the oracle; " + std::to_string(verdict.extra) +
         " extra pairs over all frames, as this broad phase may have";
}

}  // namespace

std::string csv_report(const SimulationResult& result) {
  constexpr int decimals = 6;
  std::string text = "frame,update_ms,broad_phase_ms,total_ms,pairs\n";
  for (std::size_t frame = 0; frame < result.total.size(); ++frame) {
    text += std::to_string(frame) + "," + fixed(result.update[frame], decimals) + "," +
            fixed(result.broad_phase[frame], decimals) + "," + fixed(result.total[frame], decimals) + "," +
            std::to_string(result.pairs[frame]) + "\n";
  }
  return text;
}

std::string json_report(const SimulationConfig& config, const SimulationResult& result) {
  const int bullet = btGetVersion();
  const ordered_json document = {
      {"config",
       {{"scenario", config.scenario.name},
        {"objects", config.scenario.objects},
        {"shape", config.scenario.spheres ? "sphere" : "cube"},
        {"seed", config.scenario.seed},
        {"frames", config.frames},
        {"broadphase", config.broadphase},
        {"device", config.device}}},
      {"device", result.device ? json_of(*result.device) : ordered_json()},
      {"versions",
       {{"broadcl", BROADCL_VERSION},
        {"bullet", std::to_string(bullet / 100) + "." + std::to_string(bullet % 100)}}},
      {"milliseconds",
       {{"update", json_of(result.update)},
        {"broad_phase", json_of(result.broad_phase)},
        {"total", json_of(result.total)}}},
      {"pairs", {{"mean", mean_of(result.pairs)}, {"last", result.pairs.back()}}},
      {"verify", result.verdict ? json_of(*result.verdict) : ordered_json()}};
  return text_of(document);
}

std::string table_report(const SimulationConfig& config, const SimulationResult& result) {
  const scenes::Scenario::Config& scenario = config.scenario;
  std::string text = "scenario      " + scenario.name + ", " + std::to_string(scenario.objects) +
                     (scenario.spheres ? " spheres, " : " cubes, ") + std::to_string(config.frames) +
                     " frames, seed " + std::to_string(scenario.seed) + "\n";
  text += "broad phase   " + config.broadphase + "\n";
  text += "device        " + (result.device ? one_line(result.device->label()) : "host") + "\n";
  text += "pairs         mean " + fixed(mean_of(result.pairs), 1) + ", last " +
          std::to_string(result.pairs.back()) + "\n";
  if (result.verdict) text += "verified      " + text_of(*result.verdict) + "\n";
  text += "\nms a frame           mean     median        p95    frame 0\n";
  text += table_row("update", result.update);
  text += table_row("broad phase", result.broad_phase);
  text += table_row("total", result.total);
  return text + "Frame 0 holds the warm-up; the other columns count it too.\n";
}

}  // namespace broadcl::cli
