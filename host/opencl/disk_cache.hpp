#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace broadcl::opencl {

/// Stores data between runs, mainly binaries of programs, in one file per key. Files are written under
/// another name and renamed, so that processes may share the folder. A file is used only if its length, its
/// checksum and its whole key are right: drivers crash on damaged binaries. Since drivers run them, too, only
/// the user may use what is created, and a file that somebody else may have written is not used
/// (open_own_file()).
class DiskCache {
 public:
  using Bytes = std::vector<unsigned char>;

  /// In the folder that BROADCL_CACHE_DIR names, otherwise in `broadcl` in the user's folder for caches.
  /// Without either, and if the variable is /dev/null, nothing is cached.
  DiskCache();
  explicit DiskCache(std::filesystem::path folder);

  /// The data stored under a key, if there is any, and its file can be used.
  [[nodiscard]] std::optional<Bytes> load(std::string_view key) const;

  /// Stores data under a key. Failures of the folder or the file are not errors: they only cost the time to
  /// make the data again.
  /// @returns Whether the data was stored.
  [[nodiscard]] bool store(std::string_view key, const Bytes& bytes) const;

  /// Empty if nothing is cached.
  [[nodiscard]] const std::filesystem::path& folder() const noexcept { return folder_; }
  /// The file of a key.
  [[nodiscard]] std::filesystem::path file_of(std::string_view key) const;

 private:
  std::filesystem::path folder_;
};

}  // namespace broadcl::opencl
