#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/output_file.hpp"
#include "cli/study_plan.hpp"
#include "cli/study_run_file.hpp"

namespace broadcl::cli {

/// Makes a folder if it does not exist.
/// @throws Error if it cannot be made.
void make_folder(const std::filesystem::path& path);

/// The folder of a study: study.json, one file in runs/ per run that is done, and study.csv with one row for
/// each of them. Every file appears whole or not at all, so that a study may be interrupted at any moment and
/// continued later.
class StudyFolder {
 public:
  explicit StudyFolder(std::filesystem::path folder);

  /// study.json; none if the study has not begun.
  /// @throws Error if it cannot be read, is damaged or of another format, or if there are runs without it.
  [[nodiscard]] std::optional<nlohmann::ordered_json> read_document() const;

  /// @param file Absolute, without symbolic links.
  /// @throws Error naming the option if the study writes this file itself.
  void refuse_own(const std::string& option, const std::filesystem::path& file) const;

  /// Makes the folder if it does not exist, and locks it against other studies. Must be called before a
  /// function that writes.
  /// @param document What read_document() returned, null if nothing.
  /// @throws Error if another study has locked the folder, or has changed study.json since it was read.
  void lock(const nlohmann::ordered_json& document);

  /// Writes study.json.
  /// @throws Error if it cannot be written.
  void write_document(const nlohmann::ordered_json& document) const;

  /// Looks for the files of runs.
  /// @param runs All runs that study.csv can have, in its order.
  /// @param frames Frames per run.
  /// @returns The damaged files. Their runs count as not done.
  /// @throws Error if a file cannot be read, or study.csv cannot be written.
  std::vector<std::filesystem::path> open(const std::vector<StudyRun>& runs, std::uint32_t frames);

  /// The summary of a run; null if it is not done.
  [[nodiscard]] const RunSummary* find(const StudyRun& run) const;

  /// Stores a run that is done.
  /// @param csv Its csv_report().
  /// @throws Error if it cannot be written.
  void store(const StudyRun& run, const std::string& csv);

  /// Writes all frames of all runs that are done, one row per frame.
  /// @throws Error if the file cannot be written, or if a run can no longer be read.
  void write_frames(OutputFile& file) const;

  [[nodiscard]] const std::filesystem::path& path() const noexcept { return folder_; }

 private:
  [[nodiscard]] std::filesystem::path file_of(const StudyRun& run) const;
  void write_table() const;

  std::filesystem::path folder_;
  std::shared_ptr<const void> lock_;
  std::vector<StudyRun> runs_;
  std::uint32_t frames_ = 0;
  std::map<std::string, RunSummary> done_;  // by file name
};

}  // namespace broadcl::cli
