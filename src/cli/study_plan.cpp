#include "cli/study_plan.hpp"

#include <algorithm>
#include <broadcl/error.hpp>
#include <tuple>
#include <utility>

#include "cli/text.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/random.hpp"
#include "scenes/scenario.hpp"

namespace broadcl::cli {
namespace {

std::vector<std::string> all_scenarios() {
  std::vector<std::string> names;
  for (const scenes::ScenarioInfo& scenario : scenes::Scenario::list()) names.emplace_back(scenario.name);
  return names;
}

/// Whether a run is beyond one of the limits.
bool is_cut(const StudySettings& settings, const std::string& broadphase, std::uint32_t objects) {
  return std::any_of(settings.limits.begin(), settings.limits.end(), [&](const StudyLimit& limit) {
    return limit.broadphase == broadphase && objects > limit.objects;
  });
}

std::string text_of(const std::string& name) {
  return name;
}

std::string text_of(std::uint32_t number) {
  return grouped(number);
}

/// The elements that only the first list has, for people.
template <class Value>
std::string only_in(const std::vector<Value>& list, const std::vector<Value>& other) {
  std::string text;
  for (const Value& value : list) {
    if (std::find(other.begin(), other.end(), value) != other.end()) continue;
    text += (text.empty() ? "" : ", ") + text_of(value);
  }
  return text;
}

}  // namespace

std::vector<StudyPreset> study_presets() {
  const std::vector<std::string> all = {"bullet-bf",   "bullet-sap", "bullet-bvh", "gpu-bf",
                                        "brute-force", "tiles",      "auto",       "auto+culling"};
  return {
      {.summary =
           "the set-up of Serpa and Rodrigues 2014: 500 to 3,500 objects, 2,048 frames; takes many hours",
       .settings = {.preset = "paper",
                    .scenarios = {"free-fall", "agitated", "rolling-gravity", "mixed-sizes"},
                    .objects = {500, 1250, 2000, 2750, 3500},
                    .broadphases = all,
                    .frames = 2048,
                    .repeat = 5,
                    .limits = {},
                    .left_out = {}}},
      {.summary = "500 and 1,250 objects, 48 frames; takes less than two minutes on two cores",
       .settings = {.preset = "quick",
                    .scenarios = all_scenarios(),
                    .objects = {500, 1250},
                    .broadphases = all,
                    .frames = 48,
                    .repeat = 3,
                    .limits = {},
                    .left_out = {}}},
      {.summary = "2,000 to 16,000 objects, 256 frames, without the broad phases that are too slow for that",
       .settings = {.preset = "large",
                    .scenarios = all_scenarios(),
                    .objects = {2000, 8000, 16000},
                    .broadphases = {"bullet-bvh", "gpu-bf", "brute-force", "tiles", "auto", "auto+culling"},
                    .frames = 256,
                    .repeat = 3,
                    .limits = {{.broadphase = "gpu-bf",
                                .objects = 8000,
                                .why = "one byte per pair is 128 MB per frame at 16,000"}},
                    .left_out = {"bullet-bf: takes seconds per frame at 16,000 objects",
                                 "bullet-sap: takes half a second per frame at 16,000 objects"}}},
  };
}

StudySettings find_study_preset(std::string_view name) {
  std::string names;
  for (const StudyPreset& preset : study_presets()) {
    if (preset.settings.preset == name) return preset.settings;
    names += (names.empty() ? "" : ", ") + preset.settings.preset;
  }
  throw Error("no preset is named '" + std::string(name) + "'; the presets are: " + names);
}

std::vector<std::string> cut_of(const StudySettings& settings) {
  std::vector<std::string> cut = settings.left_out;
  for (const StudyLimit& limit : settings.limits) {
    const bool applies =
        std::any_of(settings.broadphases.begin(), settings.broadphases.end(), [&](const std::string& name) {
          return std::any_of(settings.objects.begin(), settings.objects.end(),
                             [&](std::uint32_t n) { return name == limit.broadphase && n > limit.objects; });
        });
    if (!applies) continue;
    cut.push_back(limit.broadphase + " at more than " + grouped(limit.objects) + " objects" +
                  (limit.why.empty() ? "" : ": " + limit.why));
  }
  const StudySettings preset = find_study_preset(settings.preset);
  for (const auto& [what, names] :
       {std::pair("scenarios: ", only_in(preset.scenarios, settings.scenarios)),
        std::pair("numbers of objects: ", only_in(preset.objects, settings.objects)),
        std::pair("broad phases: ", only_in(preset.broadphases, settings.broadphases))}) {
    if (!names.empty()) cut.push_back(what + names);
  }
  for (const auto& [what, is, full] : {std::tuple("frames", settings.frames, preset.frames),
                                       std::tuple("repetitions", settings.repeat, preset.repeat)}) {
    if (is < full) cut.push_back(std::string(what) + " beyond " + grouped(is) + " of " + grouped(full));
  }
  return cut;
}

std::vector<std::string> limit_texts(const std::vector<StudyLimit>& limits) {
  std::vector<std::string> texts;
  texts.reserve(limits.size());
  for (const StudyLimit& limit : limits) {
    texts.push_back(limit.broadphase + "=" + std::to_string(limit.objects));
  }
  return texts;
}

std::string slug(std::string_view label) {
  std::string text;
  for (const char c : label) {
    const char lower = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    const bool is_kept = (lower >= 'a' && lower <= 'z') || (lower >= '0' && lower <= '9');
    if (is_kept) {
      text += lower;
    } else if (!text.empty() && text.back() != '-') {
      text += '-';
    }
  }
  if (text.ends_with('-')) text.pop_back();
  return text.empty() ? "device" : text;
}

bool is_auto(const std::string& broadphase) {
  return broadphase == "auto" || broadphase == "auto+culling";
}

bool runs_on_devices(const StudySettings& settings, const std::string& broadphase) {
  return scenes::find_broadphase(broadphase).on_device && !(settings.auto_on_host && is_auto(broadphase));
}

std::string describe(const StudyRun& run) {
  return run.scenario + ", " + grouped(run.objects) + (run.objects == 1 ? " object, " : " objects, ") +
         run.broadphase + (run.device.empty() ? "" : " on " + one_line(run.device)) + ", repetition " +
         std::to_string(run.repeat);
}

std::string combination_of(const StudyRun& run) {
  return run.scenario + "-" + std::to_string(run.objects) + "-" + run.broadphase +
         (run.device.empty() ? "" : "-" + slug(run.device));
}

std::string file_name(const StudyRun& run) {
  return combination_of(run) + "-" + std::to_string(run.repeat) + ".csv";
}

std::vector<StudyRun> planned_runs(const StudySettings& settings, std::span<const std::string> devices) {
  const std::string host;
  std::vector<StudyRun> runs;
  for (const std::string& scenario : settings.scenarios) {
    for (const std::uint32_t objects : settings.objects) {
      for (const std::string& broadphase : settings.broadphases) {
        if (is_cut(settings, broadphase, objects)) continue;
        const bool on_device = runs_on_devices(settings, broadphase);
        for (const std::string& device : on_device ? devices : std::span(&host, 1)) {
          for (std::uint32_t repeat = 1; repeat <= settings.repeat; ++repeat) {
            runs.push_back({scenario, objects, broadphase, device, repeat});
          }
        }
      }
    }
  }
  return runs;
}

std::vector<StudyRun> in_random_order(std::vector<StudyRun> runs, std::uint64_t seed) {
  scenes::Random(seed).shuffle(std::span(runs));
  return runs;
}

}  // namespace broadcl::cli
