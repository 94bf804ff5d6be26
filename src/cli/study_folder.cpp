#include "cli/study_folder.hpp"

#include <broadcl/error.hpp>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "cli/input_file.hpp"
#include "cli/json.hpp"
#include "cli/operating_system.hpp"
#include "cli/study_document.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

namespace fs = std::filesystem;

constexpr int decimals = 6;  // of milliseconds, as in csv_report()

/// None if there is no such file.
std::optional<std::string> read(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return std::nullopt;
  std::ifstream stream = open_input(path);
  std::string text{std::istreambuf_iterator<char>(stream), {}};
  if (stream.bad()) throw Error("cannot read " + quoted(path));
  return text;
}

void write(const fs::path& path, const std::string& text) {
  OutputFile file(path);
  file.write(text);
  file.commit();
}

std::string csv_of(const Summary& summary) {
  return fixed(summary.mean, decimals) + "," + fixed(summary.median, decimals) + "," +
         fixed(summary.p95, decimals);
}

std::string row_of(const StudyRun& run, std::uint32_t frames, const RunSummary& summary) {
  return run.scenario + "," + std::to_string(run.objects) + "," + std::to_string(frames) + "," +
         std::to_string(run.repeat) + "," + run.broadphase + "," + csv_field(run.device) + "," +
         csv_of(summary.update) + "," + csv_of(summary.broad_phase) + "," + csv_of(summary.total) + "," +
         fixed(summary.total_sum, decimals) + "," + fixed(summary.pairs_mean, 1) + "," +
         std::to_string(summary.pairs_last) + "," + fixed(summary.first_frame_total, decimals) + "\n";
}

}  // namespace

void make_folder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (!error && !fs::is_directory(path)) error = std::make_error_code(std::errc::not_a_directory);
  if (error) throw Error("cannot make the folder " + quoted(path) + ": " + error.message());
}

StudyFolder::StudyFolder(fs::path folder) : folder_(std::move(folder)) {}

std::optional<nlohmann::ordered_json> StudyFolder::read_document() const {
  const fs::path path = folder_ / "study.json";
  const std::optional<std::string> text = read(path);
  if (!text) {
    std::error_code ignored;
    const fs::path runs = folder_ / "runs";
    if (!fs::exists(runs, ignored)) return std::nullopt;
    throw Error(quoted(folder_) + " has runs but no study.json; name another folder with --out");
  }
  try {
    nlohmann::ordered_json document = nlohmann::ordered_json::parse(*text);
    if (document.at("format") != 1) {
      throw Error(quoted(path) + " was written by another version; name another folder with --out");
    }
    if (!is_sound(document)) {
      throw Error(quoted(path) + " is damaged; name another folder with --out");
    }
    (void)planned_runs(settings_of(document), device_labels(document));
    (void)difference_from_here(document);
    return std::make_optional(std::move(document));
  } catch (const nlohmann::json::exception& error) {
    throw Error(quoted(path) + " is damaged (" + one_line(error.what()) +
                "); name another folder with --out");
  }
}

void StudyFolder::refuse_own(const std::string& option, const fs::path& file) const {
  std::error_code ignored;
  const fs::path folder = fs::weakly_canonical(folder_, ignored);
  const fs::path there = file.parent_path();
  const bool is_table =
      there == folder && (file.filename() == "study.json" || file.filename() == "study.csv");
  if (is_table || there == folder / "runs" || there == folder / "recordings") {
    throw Error(option + " names a file of the study itself; name another");
  }
}

void StudyFolder::lock(const nlohmann::ordered_json& document) {
  make_folder(folder_);
  auto lock = lock_folder(folder_);
  if (!lock) {
    throw Error("another study is running in " + quoted(folder_) +
                "; wait for its end, or name another folder with --out");
  }
  if (read_document().value_or(nullptr) != document) {
    throw Error("another study has changed " + quoted(folder_ / "study.json") + "; run the command again");
  }
  lock_ = std::move(lock);
}

void StudyFolder::write_document(const nlohmann::ordered_json& document) const {
  write(folder_ / "study.json", text_of(document));
}

std::vector<fs::path> StudyFolder::open(const std::vector<StudyRun>& runs, std::uint32_t frames) {
  make_folder(folder_ / "runs");
  runs_ = runs;
  frames_ = frames;
  done_.clear();
  std::vector<fs::path> damaged;
  for (const StudyRun& run : runs_) {
    const std::optional<std::string> text = read(file_of(run));
    if (!text) continue;
    if (const std::optional<RunFrames> times = parse_run_file(*text, frames_)) {
      done_[file_name(run)] = summarize_run(*times);
    } else {
      damaged.push_back(file_of(run));
    }
  }
  write_table();
  return damaged;
}

const RunSummary* StudyFolder::find(const StudyRun& run) const {
  const auto found = done_.find(file_name(run));
  return found != done_.end() ? &found->second : nullptr;
}

void StudyFolder::store(const StudyRun& run, const std::string& csv) {
  const std::optional<RunFrames> times = parse_run_file(csv, frames_);
  if (!times) throw Error("the times of " + file_name(run) + " contradict each other");
  write(file_of(run), csv);
  done_[file_name(run)] = summarize_run(*times);
  write_table();
}

void StudyFolder::write_frames(OutputFile& file) const {
  file.write("scenario,objects,repeat,broadphase,device,frame,update_ms,broad_phase_ms,total_ms,pairs\n");
  for (const StudyRun& run : runs_) {
    if (find(run) == nullptr) continue;
    const std::optional<std::string> text = read(file_of(run));
    if (!text || !parse_run_file(*text, frames_)) throw Error("cannot read " + quoted(file_of(run)));
    const std::string start = run.scenario + "," + std::to_string(run.objects) + "," +
                              std::to_string(run.repeat) + "," + run.broadphase + "," +
                              csv_field(run.device) + ",";
    std::string rows;
    for (std::size_t at = text->find('\n') + 1; at < text->size();) {
      const std::size_t end = text->find('\n', at) + 1;
      rows += start + text->substr(at, end - at);
      at = end;
    }
    file.write(rows);
  }
}

fs::path StudyFolder::file_of(const StudyRun& run) const {
  return folder_ / "runs" / file_name(run);
}

void StudyFolder::write_table() const {
  std::string text =
      "scenario,objects,frames,repeat,broadphase,device,update_mean_ms,update_median_ms,update_p95_ms,"
      "broad_phase_mean_ms,broad_phase_median_ms,broad_phase_p95_ms,total_mean_ms,total_median_ms,"
      "total_p95_ms,total_sum_ms,pairs_mean,pairs_last,first_frame_total_ms\n";
  for (const StudyRun& run : runs_) {
    if (const RunSummary* summary = find(run)) text += row_of(run, frames_, *summary);
  }
  write(folder_ / "study.csv", text);
}

}  // namespace broadcl::cli
