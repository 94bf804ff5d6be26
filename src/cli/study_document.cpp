#include "cli/study_document.hpp"

#include <algorithm>
#include <broadcl/error.hpp>
#include <chrono>
#include <thread>

#include "cli/arguments.hpp"
#include "cli/json.hpp"
#include "cli/operating_system.hpp"
#include "cli/simulation.hpp"
#include "cli/text.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/scenario.hpp"
#include "scenes/world.hpp"

namespace broadcl::cli {
namespace {

using nlohmann::ordered_json;

/// "2026-11-21T18:00:00Z"
std::string date_of_now() {
  using namespace std::chrono;
  const auto now = floor<seconds>(system_clock::now());
  const auto today = floor<days>(now);
  const year_month_day date(today);
  const hh_mm_ss time(now - today);
  const auto two_digits = [](auto value) {
    const std::string text = std::to_string(value);
    return text.size() < 2 ? "0" + text : text;
  };
  return std::to_string(static_cast<int>(date.year())) + "-" + two_digits(unsigned{date.month()}) + "-" +
         two_digits(unsigned{date.day()}) + "T" + two_digits(time.hours().count()) + ":" +
         two_digits(time.minutes().count()) + ":" + two_digits(time.seconds().count()) + "Z";
}

ordered_json host() {
  return {
      {"cpu", processor_name()}, {"threads", std::thread::hardware_concurrency()}, {"system", system_name()}};
}

ordered_json json_of(const scenes::BroadphaseInfo& info) {
  return {{"name", info.name}, {"summary", info.summary}, {"exact", info.exact}, {"bullet", info.bullet}};
}

/// Quoted for a shell if necessary.
std::string as_argument(const std::string& text) {
  constexpr const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./,:+=@%";
  if (!text.empty() && text.find_first_not_of(plain) == std::string::npos) return text;
  std::string argument = "'";
  for (const char c : text) argument += c == '\'' ? "'\\''" : std::string(1, c);
  return argument + "'";
}

}  // namespace

ordered_json new_document(const StudySettings& settings) {
  ordered_json document = {{"format", 1},
                           {"preset", settings.preset},
                           {"command", ""},
                           {"date", date_of_now()},
                           {"versions", versions()},
                           {"host", host()},
                           {"overhead_us", scenes::measuring_overhead() * 1e6},
                           {"seed", settings.seed},
                           {"repeat", settings.repeat},
                           {"frames", settings.frames},
                           {"warm_up_frames", 1},
                           {"scenarios", settings.scenarios},
                           {"scenario_summaries", ordered_json::object()},
                           {"objects", settings.objects},
                           {"broadphases", ordered_json::array()},
                           {"auto_on_host", settings.auto_on_host},
                           {"devices", ordered_json::array()},
                           {"cut", cut_of(settings)},
                           {"limits", ordered_json::array()}};
  for (const scenes::ScenarioInfo& scenario : scenes::Scenario::list()) {
    document["scenario_summaries"][std::string(scenario.name)] = scenario.summary;
  }
  for (const std::string& name : settings.broadphases) {
    document["broadphases"].push_back(json_of(scenes::find_broadphase(name)));
  }
  for (const StudyLimit& limit : settings.limits) {
    document["limits"].push_back(
        {{"broadphase", limit.broadphase}, {"objects", limit.objects}, {"why", limit.why}});
  }
  return document;
}

bool is_sound(const ordered_json& document) {
  const auto is_in = [](const ordered_json& number, std::uint64_t lowest, std::uint64_t highest) {
    return number.is_number_unsigned() && number >= lowest && number <= highest;
  };
  const auto is_scenario = [](const ordered_json& name) {
    return std::ranges::any_of(scenes::Scenario::list(),
                               [&](const scenes::ScenarioInfo& info) { return name == info.name; });
  };
  const ordered_json& objects = document.at("objects");
  const ordered_json& scenarios = document.at("scenarios");
  return is_in(document.at("frames"), 2, most_frames) && is_in(document.at("repeat"), 1, most_repeats) &&
         document.at("seed").is_number_unsigned() && !objects.empty() &&
         std::ranges::all_of(objects, [&](const ordered_json& n) { return is_in(n, 1, most_objects); }) &&
         !scenarios.empty() && std::ranges::all_of(scenarios, is_scenario) &&
         !document.at("broadphases").empty();
}

StudySettings settings_of(const ordered_json& document) {
  StudySettings settings{.preset = document.at("preset"),
                         .scenarios = document.at("scenarios"),
                         .objects = document.at("objects"),
                         .broadphases = {},
                         .frames = document.at("frames"),
                         .repeat = document.at("repeat"),
                         .seed = document.at("seed"),
                         .limits = {},
                         .left_out = {},
                         .auto_on_host = document.value("auto_on_host", false)};
  for (const ordered_json& info : document.at("broadphases")) {
    settings.broadphases.push_back(info.at("name"));
  }
  for (const ordered_json& limit : document.at("limits")) {
    settings.limits.push_back({limit.at("broadphase"), limit.at("objects"), limit.at("why")});
  }
  return settings;
}

std::vector<std::string> device_labels(const ordered_json& document) {
  std::vector<std::string> labels;
  for (const ordered_json& device : document.at("devices")) labels.push_back(device.at("label"));
  return labels;
}

void add_device(ordered_json& document, const Device& device) {
  const std::string label = device.label();
  for (const ordered_json& known : document.at("devices")) {
    if (known.at("label") == label) {
      if (known.at("driver_version") == device.driver_version) return;
      throw Error("the study has times of '" + one_line(label) + "' with the driver '" +
                  one_line(known.at("driver_version")) + "', but its driver here is '" +
                  one_line(device.driver_version) + "'; name another folder with --out");
    }
    if (known.at("slug") == slug(label)) {
      throw Error("the files of '" + one_line(label) + "' would have the same names as those of '" +
                  one_line(known.at("label")) + "'; name another folder with --out");
    }
  }
  ordered_json added = cli::json_of(device);
  added["label"] = label;
  added["slug"] = slug(label);
  added["date"] = date_of_now();
  document["devices"].push_back(std::move(added));
}

void set_command(ordered_json& document, const std::filesystem::path& folder) {
  const StudySettings settings = settings_of(document);
  std::string command = "broadcl study --preset " + settings.preset + " --scenarios " +
                        list_of(settings.scenarios) + " --objects " + list_of(settings.objects) +
                        " --broadphases " + list_of(settings.broadphases) + " --frames " +
                        std::to_string(settings.frames) + " --repeat " + std::to_string(settings.repeat) +
                        " --seed " + std::to_string(settings.seed);
  if (!settings.limits.empty()) command += " --most " + list_of(limit_texts(settings.limits));
  std::vector<std::string> devices;
  for (const ordered_json& device : document.at("devices")) {
    const std::string label = device.at("label");
    devices.push_back(label.find(',') == std::string::npos ? label : device.at("id").get<std::string>());
  }
  if (!devices.empty() && !settings.auto_on_host) command += " --devices " + as_argument(list_of(devices));
  document["command"] = command + " --out " + as_argument(folder.string());
}

std::string difference_from_here(const ordered_json& document) {
  for (const auto& [part, here] : {std::pair("versions", versions()), std::pair("host", host())}) {
    const ordered_json& there = document.at(part);
    for (const std::string key : {"broadcl", "bullet", "cpu", "threads"}) {
      if (here.contains(key) && there.at(key) != here.at(key)) {
        return key + " " + one_line(there.at(key).dump()) + ", but here it is " +
               one_line(here.at(key).dump());
      }
    }
  }
  return {};
}

}  // namespace broadcl::cli
