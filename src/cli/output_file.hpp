#pragma once

#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "base/system.hpp"
#include "cli/process.hpp"

namespace broadcl::cli {

/// A file that appears whole or not at all: it is written next to its target and renamed to it by commit().
/// A target that is not a regular file, such as a pipe, is written in place.
class OutputFile {
 public:
  /// Checks that the target can be written, so that this is known before the work starts.
  /// @throws Error if it cannot.
  explicit OutputFile(const std::filesystem::path& target);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  OutputFile(OutputFile&&) = delete;
  OutputFile& operator=(OutputFile&&) = delete;

  /// @throws Error if writing fails, for example because the disk is full.
  void write(std::string_view bytes);

  /// Moves the file into place. If it is never called, the target stays as it was.
  /// @throws Error as write() does.
  void commit();

  /// Whether commit() replaces the target; if not, it is written in place.
  [[nodiscard]] bool is_replaced() const noexcept { return !temporary_.empty(); }

  /// The absolute path of the target, symbolic links resolved.
  [[nodiscard]] const std::filesystem::path& target() const noexcept { return target_; }

 private:
  /// Replaces the target by what it links to; weakly_canonical() does so only if that exists.
  void follow_links();
  [[nodiscard]] File open_beside_target();
  [[noreturn]] void fail(int error) const;

  std::string name_;  // the target as given, for errors
  std::filesystem::path target_;
  std::filesystem::path temporary_;  // empty if there is none
  std::optional<RemovedBySignal> removed_by_signal_;
  File file_;
};

/// A file that an option names.
struct NamedFile {
  std::string_view option;
  const OutputFile* file;  ///< Null if the option was not given.
};

/// @throws Error if two options name the same file.
void refuse_same_file(std::initializer_list<NamedFile> files);

}  // namespace broadcl::cli
