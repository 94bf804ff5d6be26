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

/// Makes a folder where there is none.
/// @throws Error where it cannot be made.
void make_folder(const std::filesystem::path& path);

/// The folder of a study: study.json, a file in runs/ for each run that is done, and study.csv with a row for
/// each of them. Every file appears whole or not at all, so that a study may end at any moment and go on
/// later.
class StudyFolder {
 public:
  explicit StudyFolder(std::filesystem::path folder);

  /// study.json; none where the study has not begun.
  /// @throws Error where it cannot be read, is damaged or of another format, and where there are runs without
  ///   it.
  [[nodiscard]] std::optional<nlohmann::ordered_json> read_document() const;

  /// Makes the folder where there is none, and keeps it from other studies from then on.
  /// @throws Error where it cannot be written, or another study has it.
  void write_document(const nlohmann::ordered_json& document);

  /// Looks for the files of runs, which are all that study.csv will ever have, in its order. Keeps the folder
  /// from other studies from then on.
  /// @param frames Of a run.
  /// @returns The files that are damaged. Their runs count as not done.
  /// @throws Error where a file cannot be read, study.csv cannot be written, or another study has the folder.
  std::vector<std::filesystem::path> open(const std::vector<StudyRun>& runs, std::uint32_t frames);

  /// What is known of a run; null where it is not done.
  [[nodiscard]] const RunSummary* find(const StudyRun& run) const;

  /// Keeps a run that is done.
  /// @param csv What csv_report() makes of it.
  /// @throws Error where it cannot be written.
  void store(const StudyRun& run, const std::string& csv);

  /// Writes all frames of all runs that are done, a row a frame.
  /// @throws Error where it cannot be written, or a run cannot be read any more.
  void write_frames(OutputFile& file) const;

  [[nodiscard]] const std::filesystem::path& path() const noexcept { return folder_; }

 private:
  [[nodiscard]] std::filesystem::path file_of(const StudyRun& run) const;
  void write_table() const;
  void keep();

  std::filesystem::path folder_;
  std::shared_ptr<const void> lock_;
  std::vector<StudyRun> runs_;
  std::uint32_t frames_ = 0;
  std::map<std::string, RunSummary> done_;  // by the names of their files
};

}  // namespace broadcl::cli
