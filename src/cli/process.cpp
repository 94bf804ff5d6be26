#include "cli/process.hpp"

#ifndef _WIN32
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <string>
#endif

namespace broadcl::cli {

#ifdef _WIN32

void prepare_process() {}

RemovedBySignal::RemovedBySignal(const std::filesystem::path& /*file*/) {}

RemovedBySignal::~RemovedBySignal() = default;

#else

enum class FileState { unused, changing, registered };

struct RegisteredFile {
  std::atomic<FileState> state;
  std::array<char, 4096> path;

  static_assert(std::atomic<FileState>::is_always_lock_free);

  /// Changes the state if it is the expected one.
  bool change(FileState expected, FileState next) { return state.compare_exchange_strong(expected, next); }
};

namespace {

// A handler of signals must not allocate.
std::array<RegisteredFile, 16> registered_files;

void remove_files_and_end(int number) {
  for (RegisteredFile& file : registered_files) {
    // What is taken here is never given back, so that no other thread changes the path meanwhile.
    if (file.change(FileState::registered, FileState::changing)) unlink(file.path.data());
  }
  (void)std::signal(number, SIG_DFL);
  (void)std::raise(number);
}

void open_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) != -1) continue;
    // It gets the lowest number that is free. Standard output cannot be written, so that its loss is
    // reported.
    (void)open("/dev/null", stream == STDERR_FILENO ? O_WRONLY : O_RDONLY);
  }
}

}  // namespace

void prepare_process() {
  open_standard_streams();
  (void)std::signal(SIGXFSZ, SIG_IGN);
  for (const int number : {SIGINT, SIGQUIT, SIGTERM, SIGHUP, SIGPIPE}) {
    // What was ignored, as by nohup, stays so.
    if (std::signal(number, remove_files_and_end) == SIG_IGN) (void)std::signal(number, SIG_IGN);
  }
}

RemovedBySignal::RemovedBySignal(const std::filesystem::path& file) {
  const std::string& path = file.native();
  for (RegisteredFile& candidate : registered_files) {
    if (path.size() >= candidate.path.size() || !candidate.change(FileState::unused, FileState::changing))
      continue;
    std::copy_n(path.c_str(), path.size() + 1, candidate.path.begin());
    candidate.state = FileState::registered;
    registered_ = &candidate;
    return;
  }
}

RemovedBySignal::~RemovedBySignal() {
  if (registered_ != nullptr) registered_->change(FileState::registered, FileState::unused);
}

#endif

}  // namespace broadcl::cli
