#include "cli/trace.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "cli/json.hpp"

namespace broadcl::cli {
namespace {

using nlohmann::ordered_json;

/// In whole nanoseconds, as clocks tick, sums are exact, so that nested events stay nested.
using Nanoseconds = std::int64_t;

constexpr int process = 1;
constexpr int host_thread = 1;
constexpr int device_thread = 2;

Nanoseconds of_seconds(double seconds) {
  return std::llround(seconds * 1e9);
}

Nanoseconds of_milliseconds(double milliseconds) {
  return std::llround(milliseconds * 1e6);
}

double microseconds(Nanoseconds time) {
  return static_cast<double>(time) / 1e3;
}

std::string line(const ordered_json& json) {
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

/// Writes events, one per line.
class Events {
 public:
  explicit Events(OutputFile& file) : file_(file) {}

  void name(const char* what, int thread, std::string_view name) {
    write({{"ph", "M"}, {"name", what}, {"pid", process}, {"tid", thread}, {"args", {{"name", name}}}});
  }

  void complete(std::string_view name, int thread, Nanoseconds begin, Nanoseconds duration,
                std::size_t frame) {
    write({{"ph", "X"},
           {"name", name},
           {"pid", process},
           {"tid", thread},
           {"ts", microseconds(begin)},
           {"dur", microseconds(duration)},
           {"args", {{"frame", frame}}}});
  }

  void counter(std::string_view name, Nanoseconds time, std::size_t value) {
    write({{"ph", "C"},
           {"name", name},
           {"pid", process},
           {"ts", microseconds(time)},
           {"args", {{name, value}}}});
  }

 private:
  void write(const ordered_json& event) {
    file_.write((first_ ? "\n" : ",\n") + line(event));
    first_ = false;
  }

  OutputFile& file_;
  bool first_ = true;
};

/// Writes the device stages as late as possible: each command ends before the next stage "wait" does.
/// @param update When the update began.
/// @param end When it ended at the latest.
void write_device_stages(Events& events, const std::vector<Stage>& stages, Nanoseconds update,
                         Nanoseconds end, std::size_t frame) {
  Nanoseconds origin = end;
  Nanoseconds waited = end;
  std::for_each(stages.rbegin(), stages.rend(), [&](const Stage& stage) {
    if (stage.name == "wait") waited = update + of_seconds(stage.host_start) + of_seconds(stage.host_seconds);
    if (stage.device_seconds == 0) return;
    origin = std::min(origin, waited - of_seconds(stage.device_start) - of_seconds(stage.device_seconds));
  });
  for (const Stage& stage : stages) {
    if (stage.device_seconds == 0) continue;
    events.complete(stage.name, device_thread, origin + of_seconds(stage.device_start),
                    of_seconds(stage.device_seconds), frame);
  }
}

/// Writes the events of a frame, each before the events nested in it.
void write_frame(Events& events, const SimulationResult& result, std::size_t frame) {
  const Nanoseconds begin =
      std::chrono::duration_cast<std::chrono::nanoseconds>(result.start[frame] - result.start.front())
          .count();
  const Nanoseconds end = begin + of_milliseconds(result.total[frame]);
  const Nanoseconds update = begin + of_milliseconds(result.update_start[frame]);
  const Nanoseconds broad_phase = begin + of_milliseconds(result.broad_phase_start[frame]);
  const Nanoseconds broad_phase_end = broad_phase + of_milliseconds(result.broad_phase[frame]);
  events.complete("frame", host_thread, begin, end - begin, frame);
  events.complete("prediction", host_thread, begin, update - begin, frame);
  events.complete("update", host_thread, update, of_milliseconds(result.update[frame]), frame);
  events.complete("broad phase", host_thread, broad_phase, broad_phase_end - broad_phase, frame);
  for (const Stage& stage : result.stages[frame]) {
    events.complete(stage.name, host_thread, broad_phase + of_seconds(stage.host_start),
                    of_seconds(stage.host_seconds), frame);
  }
  write_device_stages(events, result.stages[frame], broad_phase, broad_phase_end, frame);
  events.counter("pairs", broad_phase_end, result.pairs[frame]);
  events.complete("narrow phase and solver", host_thread, broad_phase_end, end - broad_phase_end, frame);
}

}  // namespace

void write_trace(OutputFile& file, const SimulationConfig& config, const SimulationResult& result) {
  file.write("{\"displayTimeUnit\": \"ms\",\n\"otherData\": " + line(facts(config, result)) +
             ",\n\"traceEvents\": [");
  Events events(file);
  events.name("process_name", host_thread, "broadcl simulate");
  events.name("thread_name", host_thread, "host");
  if (result.device) events.name("thread_name", device_thread, "device");
  for (std::size_t frame = 0; frame < result.total.size(); ++frame) write_frame(events, result, frame);
  file.write("\n]}\n");
}

}  // namespace broadcl::cli
