#pragma once

#include <filesystem>

/// What the program does about its process.
namespace broadcl::cli {

/// Call it first. Standard streams that are closed are opened; otherwise a file would take the place of one
/// and get what is written to it. From then on, a signal that ends the program first removes the files of
/// RemovedBySignal, and a file that becomes too large is an error of writing.
void prepare_process();

struct RegisteredFile;

/// A file that is removed if a signal ends the program while this object exists. (Not on Windows, where an
/// open file cannot be removed.)
class RemovedBySignal {
 public:
  /// @param file Absolute; it need not exist yet.
  explicit RemovedBySignal(const std::filesystem::path& file);
  ~RemovedBySignal();
  RemovedBySignal(const RemovedBySignal&) = delete;
  RemovedBySignal& operator=(const RemovedBySignal&) = delete;
  RemovedBySignal(RemovedBySignal&&) = delete;
  RemovedBySignal& operator=(RemovedBySignal&&) = delete;

 private:
  RegisteredFile* registered_ = nullptr;  // null if there was no room
};

}  // namespace broadcl::cli
