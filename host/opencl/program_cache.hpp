#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace broadcl::opencl {

/// Binaries of built programs on disk, one file a program. Files are written under another name and renamed,
/// so that processes may share the folder, and a file is given out only when its length, its checksum and its
/// whole key are right: drivers crash on damaged binaries.
class ProgramCache {
 public:
  using Binary = std::vector<unsigned char>;

  /// The folder that BROADCL_CACHE_DIR names, else `broadcl` in the user's folder for caches; without either,
  /// nothing is cached.
  ProgramCache();
  explicit ProgramCache(std::filesystem::path folder);

  /// The binary stored under a key; none where there is none or where its file is damaged.
  [[nodiscard]] std::optional<Binary> load(std::string_view key) const;

  /// Stores a binary. A default folder that cannot be written only costs time and is passed over in silence.
  /// @throws Error when the folder was asked for by name and cannot be written.
  void store(std::string_view key, const Binary& binary) const;

  /// Where a key's binary lies.
  [[nodiscard]] std::filesystem::path file_of(std::string_view key) const;

 private:
  std::filesystem::path folder_;
  bool asked_for_ = false;
};

}  // namespace broadcl::opencl
