#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/device.hpp>

namespace broadcl::opencl {

/// Stores data about a device between runs, mainly binaries of programs, in one file per key. Files are
/// written under another name and renamed, so that processes may share the folder. A file is used only if its
/// checksum and its whole key are right: drivers crash on damaged binaries. Since drivers run them, too, a
/// folder in which somebody else may write is not used.
class DiskCache {
 public:
  using Bytes = std::vector<unsigned char>;

  /// In the folder that BROADCL_CACHE_DIR names, otherwise in `broadcl` in the user's folder for caches.
  /// Without either, and if the variable is /dev/null, nothing is cached.
  explicit DiskCache(const Device& device);
  /// @param driver Precedes all keys.
  DiskCache(std::filesystem::path folder, std::string driver);

  /// The data stored under a key; empty if there is none, or if its file cannot be used.
  [[nodiscard]] Bytes load(std::string_view key) const;

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
  std::string driver_;
};

}  // namespace broadcl::opencl
