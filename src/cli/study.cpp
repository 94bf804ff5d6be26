#include <CLI/CLI.hpp>
#include <algorithm>
#include <broadcl/error.hpp>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/system.hpp"
#include "cli/arguments.hpp"
#include "cli/progress_bar.hpp"
#include "cli/simulation.hpp"
#include "cli/study_cost.hpp"
#include "cli/study_document.hpp"
#include "cli/study_folder.hpp"
#include "cli/study_plan.hpp"
#include "cli/study_recordings.hpp"
#include "cli/study_report.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/scenario.hpp"

namespace broadcl::cli {
namespace {

/// The command line. Whatever it leaves out is taken from the study in the folder if there is one, otherwise
/// from the preset.
struct StudyOptions {
  std::optional<std::string> preset;
  std::optional<std::vector<std::string>> scenarios;
  std::optional<std::vector<std::uint32_t>> objects;
  std::optional<std::vector<std::string>> broadphases;
  std::optional<std::vector<StudyLimit>> most;
  std::optional<std::vector<std::string>> devices;
  std::optional<std::uint32_t> frames;
  std::optional<std::uint32_t> repeat;
  std::optional<std::uint64_t> seed;
  std::string out = "study";
  std::string frames_csv;
};

/// Whether two lists have the same elements, in any order.
template <class Value>
bool are_same(std::vector<Value> a, std::vector<Value> b) {
  std::sort(a.begin(), a.end());
  std::sort(b.begin(), b.end());
  return a == b;
}

/// Adds a limit, or replaces the one of the same broad phase; an equal one stays, with its reason.
/// @throws Error for a broad phase that is not measured.
void set_limit(StudySettings& settings, const StudyLimit& limit) {
  const std::vector<std::string>& names = settings.broadphases;
  if (std::find(names.begin(), names.end(), limit.broadphase) == names.end()) {
    throw Error("--most: '" + limit.broadphase +
                "' is not one of the measured broad phases: " + list_of(names));
  }
  std::vector<StudyLimit>& limits = settings.limits;
  const auto other = std::find_if(limits.begin(), limits.end(), [&](const StudyLimit& known) {
    return known.broadphase == limit.broadphase;
  });
  if (other == limits.end()) {
    limits.push_back(limit);
  } else if (other->objects != limit.objects) {
    *other = limit;
  }
}

/// Whether `auto` stays on the host: no device is named, and the default is not one that it uses by itself.
bool auto_stays_on_host(const StudyOptions& options) {
  if (options.devices || environment("BROADCL_DEVICE")) return false;
  try {
    return select_device().type == DeviceType::cpu;
  } catch (const Error&) {
    return true;  // there is none
  }
}

/// @throws Error for unknown names.
StudySettings new_settings(const StudyOptions& options) {
  StudySettings settings = find_study_preset(options.preset.value_or("quick"));
  if (options.scenarios) settings.scenarios = *options.scenarios;
  if (options.objects) settings.objects = *options.objects;
  if (options.broadphases && !are_same(*options.broadphases, settings.broadphases)) {
    // Limits of the preset do not apply to a user's own choice.
    settings.broadphases = *options.broadphases;
    settings.limits.clear();
    settings.left_out.clear();
  }
  std::set<std::string> limited;
  for (const StudyLimit& limit : options.most.value_or(std::vector<StudyLimit>())) {
    if (!limited.insert(limit.broadphase).second) {
      throw Error("--most: '" + limit.broadphase + "' is given twice");
    }
    set_limit(settings, limit);
  }
  settings.frames = options.frames.value_or(settings.frames);
  settings.repeat = options.repeat.value_or(settings.repeat);
  settings.seed = options.seed.value_or(settings.seed);
  for (const std::string& name : settings.scenarios) (void)scenes::Scenario({.name = name, .objects = 1});
  for (const std::string& name : settings.broadphases) (void)scenes::find_broadphase(name);
  settings.auto_on_host = std::any_of(settings.broadphases.begin(), settings.broadphases.end(), is_auto) &&
                          auto_stays_on_host(options);
  return settings;
}

/// @throws Error if the options contradict the study in the folder.
void refuse_contradictions(const StudyOptions& options, const nlohmann::ordered_json& document) {
  const std::string holds = quoted(std::filesystem::path(options.out)) + " holds a study with ";
  const auto expect = [&](bool same, const std::string& option, const std::string& there) {
    if (same) return;
    throw Error(holds + option + " " + there + "; leave " + option +
                " out to continue it, or name another folder with --out");
  };
  const StudySettings there = settings_of(document);
  const auto expect_number = [&](const std::string& option, const auto& asked, const auto& number) {
    expect(!asked || *asked == number, option, std::to_string(number));
  };
  const auto expect_list = [&](const std::string& option, const auto& asked, const auto& list) {
    expect(!asked || are_same(*asked, list), option, list_of(list));
  };
  expect(!options.preset || *options.preset == there.preset, "--preset", there.preset);
  expect_list("--scenarios", options.scenarios, there.scenarios);
  expect_list("--objects", options.objects, there.objects);
  expect_list("--broadphases", options.broadphases, there.broadphases);
  const std::vector<std::string> limits = limit_texts(there.limits);
  for (const std::string& limit : limit_texts(options.most.value_or(std::vector<StudyLimit>()))) {
    expect(std::find(limits.begin(), limits.end(), limit) != limits.end(), "--most",
           limits.empty() ? "for no broad phase" : list_of(limits));
  }
  expect_number("--frames", options.frames, there.frames);
  expect_number("--repeat", options.repeat, there.repeat);
  expect_number("--seed", options.seed, there.seed);
  if (there.auto_on_host && !auto_stays_on_host(options)) {
    throw Error(holds +
                "auto on the host, as no device was named and there was no GPU; name no device to continue "
                "it, or name another folder with --out");
  }
  const std::string difference = difference_from_here(document);
  if (!difference.empty()) throw Error(holds + difference + "; name another folder with --out");
}

Device device_labelled(const std::string& label) {
  for (const Device& device : devices()) {
    if (device.label() == label) return device;
  }
  throw Error("the study has times of '" + one_line(label) +
              "', which is not among the devices now; name the devices to continue with in --devices");
}

/// The devices to measure on: those asked for, otherwise those of the study, otherwise the best one.
std::vector<Device> chosen_devices(const StudyOptions& options, const StudySettings& settings,
                                   const std::vector<std::string>& known) {
  std::vector<Device> chosen;
  for (const std::string& selector : options.devices.value_or(std::vector<std::string>())) {
    const Device device = select_device(selector);
    for (const Device& other : chosen) {
      if (other.label() == device.label()) {
        throw Error("--devices: '" + selector + "' is '" + one_line(device.label()) +
                    "', which is given already");
      }
    }
    chosen.push_back(device);
  }
  const bool needed = std::any_of(settings.broadphases.begin(), settings.broadphases.end(),
                                  [&](const std::string& name) { return runs_on_devices(settings, name); });
  if (!needed) return {};
  if (!chosen.empty()) return chosen;
  for (const std::string& label : known) chosen.push_back(device_labelled(label));
  if (chosen.empty()) chosen.push_back(select_device());
  return chosen;
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Does the runs that are missing.
class Measurement {
 public:
  Measurement(StudyFolder& folder, const StudySettings& settings, const std::vector<Device>& devices)
      : folder_(folder), settings_(settings), devices_(devices), cost_(settings.frames) {}

  /// @param runs In the order to measure them.
  /// @returns One line per failed run.
  std::vector<std::string> measure(const std::vector<StudyRun>& runs) {
    std::vector<StudyRun> missing;
    for (const StudyRun& run : runs) {
      if (const RunSummary* summary = folder_.find(run)) {
        took(run, (summary->first_frame_total + summary->total_sum) * 1e-3);
      } else if (run.device.empty() || device_of(run) != nullptr) {
        missing.push_back(run);
      }
    }
    std::vector<std::string> failed;
    for (std::size_t k = 0; k < missing.size(); ++k) {
      double later = 0;
      for (std::size_t j = k + 1; j < missing.size(); ++j) later += cost_.expected(missing[j]);
      if (const std::optional<std::string> why = measure_one(missing[k], later)) {
        failed.push_back(describe(missing[k]) + ": " + one_line(*why));
        progress_.say("broadcl: " + failed.back());
      }
    }
    return failed;
  }

 private:
  [[nodiscard]] const Device* device_of(const StudyRun& run) const {
    const auto found = std::find_if(devices_.begin(), devices_.end(),
                                    [&](const Device& device) { return device.label() == run.device; });
    return found != devices_.end() ? &*found : nullptr;
  }

  void took(const StudyRun& run, double seconds) {
    cost_.add(run, seconds);
    spent_ += seconds;
  }

  /// @param later Expected seconds of the runs after this one.
  /// @returns Why the run failed, if it did.
  std::optional<std::string> measure_one(const StudyRun& run, double later) {
    const Device* device = device_of(run);
    SimulationConfig config;
    config.scenario.name = run.scenario;
    config.scenario.objects = run.objects;
    config.scenario.seed = settings_.seed;
    config.frames = settings_.frames;
    config.broadphase = run.broadphase;
    if (device != nullptr) config.device = device->id();
    const double own = cost_.expected(run);
    const auto begin = std::chrono::steady_clock::now();
    std::uint32_t frames = 0;
    std::optional<SimulationResult> result;
    try {
      result = simulate(config, [&] {
        const double share = ++frames / static_cast<double>(settings_.frames);
        progress_.show((spent_ + own * share) / (spent_ + own + later), own * (1 - share) + later);
      });
    } catch (const std::exception& error) {
      return error.what();
    }
    took(run, seconds_since(begin));
    folder_.store(run, csv_report(*result));
    return std::nullopt;
  }

  StudyFolder& folder_;
  const StudySettings& settings_;
  const std::vector<Device>& devices_;
  StudyCost cost_;
  double spent_ = 0;  // seconds, for all runs that are done
  ProgressBar progress_;
};

Exit run_study(const StudyOptions& options) {
  StudyFolder folder(options.out);
  std::optional<nlohmann::ordered_json> document = folder.read_document();
  if (document) refuse_contradictions(options, *document);
  const StudySettings settings = document ? settings_of(*document) : new_settings(options);
  const std::vector<Device> devices =
      chosen_devices(options, settings, document ? device_labels(*document) : std::vector<std::string>());
  std::optional<OutputFile> frames_csv;
  if (!options.frames_csv.empty()) {
    frames_csv.emplace(options.frames_csv);
    folder.refuse_own("--frames-csv", frames_csv->target());
  }
  const nlohmann::ordered_json before = document.value_or(nullptr);
  if (!document) document = new_document(settings);
  for (const Device& device : devices) add_device(*document, device);
  folder.lock(before);
  if (*document != before) {
    set_command(*document, options.out);
    folder.write_document(*document);
  }

  const std::vector<StudyRun> runs = planned_runs(settings, device_labels(*document));
  for (const std::filesystem::path& file : folder.open(runs, settings.frames)) {
    std::cerr << "broadcl: " << quoted(file) << " is damaged; its run is repeated\n";
  }
  const std::vector<std::string> failed =
      Measurement(folder, settings, devices).measure(in_random_order(runs, settings.seed));
  record_scenes(folder, settings);
  if (frames_csv) {
    folder.write_frames(*frames_csv);
    frames_csv->commit();
  }
  std::cout << study_report(folder, settings, runs);
  if (failed.empty()) return Exit::success;
  std::cerr << "broadcl: " << failed.size() << " of " << counted(runs.size(), "run")
            << " failed; run the same command again to retry them:\n";
  for (const std::string& line : failed) std::cerr << "  " << line << '\n';
  return Exit::failure;
}

/// "NAME=N"
StudyLimit parse_limit(const std::string& text) {
  const std::size_t mark = text.rfind('=');
  if (mark == std::string::npos) {
    throw CLI::ValidationError("--most",
                               "'" + text + "' is not NAME=N, a broad phase and a number of objects");
  }
  return {.broadphase = text.substr(0, mark),
          .objects = parse_number("--most", text.substr(mark + 1), 1U, most_objects),
          .why = {}};
}

std::string study_footer() {
  std::string text =
      "Options that are not given are taken from the preset. If the folder holds a study with the same "
      "settings, only its missing runs are done, and new devices are added to it. If no device is named and "
      "there is no GPU, 'auto' is measured on the host.\nPresets:\n";
  for (const StudyPreset& preset : study_presets()) {
    text += named_row(preset.settings.preset, preset.summary);
  }
  return text + "For scenarios and broad phases, see 'broadcl simulate --help'.\n";
}

}  // namespace

Verb add_study(CLI::App& program) {
  auto options = std::make_shared<StudyOptions>();
  CLI::App* verb = program.add_subcommand(
      "study", "Measure scenarios, numbers of objects and broad phases, and store the results in a folder");
  const auto as_is = [](const std::string& text) { return text; };
  verb->add_option_function<std::string>(
          "--preset", [options](const std::string& name) { options->preset = one_line(name); },
          "What to measure; see below")
      ->type_name("NAME")
      ->default_str("quick");
  add_list(*verb, "--scenarios", options->scenarios, "A,B", as_is, "Scenarios to simulate");
  add_list(
      *verb, "--objects", options->objects, "N,M",
      [](const std::string& text) { return parse_number("--objects", text, 1U, most_objects); },
      "Numbers of objects");
  add_list(*verb, "--broadphases", options->broadphases, "A,B", as_is, "Broad phases to measure");
  add_list(*verb, "--most", options->most, "A=N,B=M", parse_limit,
           "Limit the number of objects for a broad phase that becomes too slow");
  add_list(*verb, "--devices", options->devices, "A,B", as_is,
           "Devices, each as for --device of the other verbs");
  add_optional_number(*verb, "--frames", options->frames, 2U, most_frames,
                      "Frames per run; the first is the warm-up");
  add_optional_number(*verb, "--repeat", options->repeat, 1U, most_repeats, "Runs per combination");
  add_optional_number(*verb, "--seed", options->seed, std::uint64_t{0}, UINT64_MAX,
                      "Seed of the simulations and of the order of the runs");
  verb->add_option("--out", options->out, "The folder for the results")
      ->check([](const std::string& name) { return name.empty() ? "name a folder" : std::string(); }, "")
      ->type_name("DIR")
      ->capture_default_str();
  add_file(*verb, "--frames-csv", options->frames_csv,
           "Write all frames of all runs in the folder here, one row per frame");
  verb->footer(study_footer());
  return {verb, [options] { return run_study(*options); }};
}

}  // namespace broadcl::cli
