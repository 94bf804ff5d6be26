#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace broadcl::opencl {

/// What is kept from run to run, binaries of built programs above all, one file a key. Files are written
/// under another name and renamed, so that processes may share the folder, and a file is given out only when
/// its length, its checksum and its whole key are right: drivers crash on damaged binaries.
class DiskCache {
 public:
  using Bytes = std::vector<unsigned char>;

  /// The folder that BROADCL_CACHE_DIR names, else `broadcl` in the user's folder for caches; without either,
  /// nothing is cached.
  DiskCache();
  explicit DiskCache(std::filesystem::path folder);

  /// What was stored under a key; none where nothing was or where its file is damaged.
  [[nodiscard]] std::optional<Bytes> load(std::string_view key) const;

  /// Stores under a key. A default folder that cannot be written only costs time and is passed over in
  /// silence.
  /// @throws Error when the folder was asked for by name and cannot be written.
  void store(std::string_view key, const Bytes& bytes) const;

  /// Where that lies.
  [[nodiscard]] std::filesystem::path file_of(std::string_view key) const;

 private:
  std::filesystem::path folder_;
  bool asked_for_ = false;
};

}  // namespace broadcl::opencl
