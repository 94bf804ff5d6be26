#include "cli/study_report.hpp"

#include <algorithm>
#include <optional>

#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr std::size_t name_width = 17;
constexpr std::size_t number_width = 8;

/// The median over the runs of a combination of the median over the frames; none if no run is done.
std::optional<double> median_total(const StudyFolder& folder, StudyRun run, std::uint32_t repeats) {
  std::vector<double> totals;
  for (run.repeat = 1; run.repeat <= repeats; ++run.repeat) {
    if (const RunSummary* summary = folder.find(run)) totals.push_back(summary->total.median);
  }
  return totals.empty() ? std::nullopt : std::optional(summarize(totals).median);
}

std::size_t column_width(const std::string& broadphase) {
  return std::max<std::size_t>(broadphase.size(), number_width) + 2;
}

std::string table(const StudyFolder& folder, const StudySettings& settings, const std::string& device,
                  const std::vector<StudyRun>& runs) {
  std::string text = left("", name_width) + right("objects", number_width);
  for (const std::string& name : settings.broadphases) text += right(name, column_width(name));
  text += "\n";
  for (const std::string& scenario : settings.scenarios) {
    for (const std::uint32_t objects : settings.objects) {
      text += left(scenario, name_width) + right(grouped(objects), number_width);
      for (const std::string& name : settings.broadphases) {
        const auto run = std::find_if(runs.begin(), runs.end(), [&](const StudyRun& candidate) {
          return candidate.scenario == scenario && candidate.objects == objects &&
                 candidate.broadphase == name && (candidate.device.empty() || candidate.device == device);
        });
        const std::optional<double> total =
            run != runs.end() ? median_total(folder, *run, settings.repeat) : std::nullopt;
        text += right(total ? fixed(*total, 3) : "-", column_width(name));
      }
      text += "\n";
    }
  }
  return text;
}

}  // namespace

std::string study_report(const StudyFolder& folder, const StudySettings& settings,
                         const std::vector<StudyRun>& runs) {
  const auto done = std::count_if(runs.begin(), runs.end(),
                                  [&](const StudyRun& run) { return folder.find(run) != nullptr; });
  std::vector<std::string> devices;
  for (const StudyRun& run : runs) {
    if (!run.device.empty() && std::find(devices.begin(), devices.end(), run.device) == devices.end()) {
      devices.push_back(run.device);
    }
  }
  if (devices.empty()) devices.emplace_back();
  std::string text = "study         " + settings.preset + ", " + std::to_string(done) + " of " +
                     counted(runs.size(), "run") + " done, of " + counted(settings.frames, "frame") +
                     " each\n";
  for (const std::string& device : devices) {
    text += "device        " + (device.empty() ? "host" : one_line(device)) +
            "\n\nmedian total, ms per frame (without frame 0)\n" + table(folder, settings, device, runs) +
            "\n";
  }
  return text + "files         study.json, study.csv and runs/ in " + quoted(folder.path()) +
         "\nreport        made by: scripts/report " + quoted(folder.path()) + "\n";
}

}  // namespace broadcl::cli
