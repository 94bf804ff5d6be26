#include "cli/output_file.hpp"

#include <atomic>
#include <broadcl/error.hpp>
#include <cerrno>
#include <cstdio>
#include <sstream>
#include <system_error>

#include "cli/text.hpp"

namespace broadcl::cli {

namespace fs = std::filesystem;

OutputFile::OutputFile(const fs::path& target) : name_(quoted(target)) {
  if (target == "-") throw Error("files are not written to standard output ('-'); name a file");
  std::error_code error;
  target_ = fs::absolute(target, error);
  if (error) fail(error.value());
  std::error_code ignored;
  const fs::file_status status = fs::status(target, ignored);
  if (fs::is_directory(status)) throw Error(name_ + " is a directory; name a file to write");
  if (fs::exists(status)) {
    file_.reset(std::fopen(target.string().c_str(), fs::is_regular_file(status) ? "r+b" : "wb"));
    if (!file_) fail(errno);
    if (!fs::is_regular_file(status)) return;
  }
  follow_links();
  const fs::path resolved = fs::weakly_canonical(target_, ignored);
  if (!resolved.empty()) target_ = resolved;
  file_ = open_beside_target();
  if (fs::exists(status)) fs::permissions(temporary_, status.permissions(), ignored);
}

OutputFile::~OutputFile() {
  file_.reset();
  std::error_code ignored;
  if (!temporary_.empty()) fs::remove(temporary_, ignored);
}

void OutputFile::write(std::string_view bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size()) fail(errno);
}

void OutputFile::commit() {
  if (std::fclose(file_.release()) != 0) fail(errno);
  if (temporary_.empty()) return;
  std::error_code error;
  fs::rename(temporary_, target_, error);
  if (error) fail(error.value());
  temporary_.clear();
  removed_by_signal_.reset();
}

void OutputFile::follow_links() {
  constexpr int most_links = 40;
  std::error_code ignored;
  for (int links = 0; fs::is_symlink(fs::symlink_status(target_, ignored)); ++links) {
    if (links == most_links) fail(ELOOP);
    target_ = target_.parent_path() / fs::read_symlink(target_, ignored);
  }
}

File OutputFile::open_beside_target() {
  static std::atomic<unsigned> serial{0};
  while (true) {
    // The name of the target may be too long to append to.
    std::ostringstream name;
    name << ".broadcl." << process_id() << '.' << serial++ << ".tmp";
    fs::path candidate = target_.parent_path() / name.str();
    removed_by_signal_.emplace(candidate);
    File file(std::fopen(candidate.string().c_str(), "wbx"));
    if (file) {
      temporary_ = std::move(candidate);
      return file;
    }
    if (errno != EEXIST) fail(errno);
  }
}

void OutputFile::fail(int error) const {
  throw Error("cannot write " + name_ + ": " + std::generic_category().message(error));
}

void refuse_same_file(std::initializer_list<NamedFile> files) {
  for (const NamedFile* second = files.begin(); second != files.end(); ++second) {
    for (const NamedFile* first = files.begin(); first != second; ++first) {
      if (first->file == nullptr || second->file == nullptr) continue;
      if (!first->file->is_replaced() || first->file->target() != second->file->target()) continue;
      throw Error(std::string(first->option) + " and " + std::string(second->option) + " name the same file");
    }
  }
}

}  // namespace broadcl::cli
