#include "cli/study_recordings.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/recording.hpp"
#include "cli/simulation.hpp"

namespace broadcl::cli {
namespace {

constexpr std::uint32_t most_recorded_objects = 3500;
constexpr std::uint32_t most_recorded_frames = 300;

std::uint32_t middle(std::vector<std::uint32_t> numbers) {
  std::sort(numbers.begin(), numbers.end());
  return numbers[numbers.size() / 2];
}

}  // namespace

void record_scenes(const StudyFolder& folder, const StudySettings& settings) {
  const std::filesystem::path recordings = folder.path() / "recordings";
  make_folder(recordings);
  SimulationConfig config;
  config.scenario.objects = std::min(most_recorded_objects, middle(settings.objects));
  config.scenario.seed = settings.seed;
  config.frames = std::min(most_recorded_frames, settings.frames);
  config.broadphase = "sweep-and-prune";
  for (const std::string& scenario : settings.scenarios) {
    const std::filesystem::path file = recordings / (scenario + ".npy");
    if (std::filesystem::exists(file)) continue;
    config.scenario.name = scenario;
    RecordingWriter recording(file, recording_info(config));
    (void)simulate(
        config, [] {}, &recording);
    recording.commit();
  }
}

}  // namespace broadcl::cli
