#pragma once

#include <broadcl/aabb.hpp>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "cli/npy.hpp"
#include "cli/output_file.hpp"

/// Recordings of moving boxes. Block 0 is the initial state, then comes one block per frame; each has the
/// same n boxes. The extension of the file selects the format:
///
/// `.aabbs`, the format of Broadmark (Serpa and Rodrigues, "Broadmark: A Testing Framework for Broad-Phase
/// Collision Detection Algorithms"). Everything is little-endian: char[128] name of the scene, char[128] type
/// of the objects, int32 n, int32 frames, two int32 zeros, the box of the world; then 1 + frames blocks of n
/// boxes. A box is eight float32: min x, y, z, 0, max x, y, z, 0.
///
/// `.npy`: an array of shape (1 + frames, n, 6): min x, y, z, max x, y, z. Written as float32; read as
/// float32 or float64, which is rounded outward, in either byte order.
namespace broadcl::cli {

/// What is known about a recording before its first block.
struct RecordingInfo {
  std::string scene;         ///< Its name; stored only by `.aabbs`, truncated to 127 bytes.
  std::string objects;       ///< Their type; stored like `scene`.
  Aabb world;                ///< The bounds of the world; stored only by `.aabbs`.
  std::uint32_t boxes = 0;   ///< Per block: 1 to 2^31 - 1.
  std::uint32_t frames = 0;  ///< Without the initial state: 1 to 2^31 - 1.
};

/// Writes a recording block by block; the file appears whole, at commit(), or not at all.
class RecordingWriter {
 public:
  /// @throws Error if the extension is unknown or the file cannot be written.
  RecordingWriter(const std::filesystem::path& file, const RecordingInfo& info);

  /// Writes the next block: first the initial state, then each frame.
  /// @throws Error if the number of boxes differs from what was announced, if there are more blocks than
  /// announced, and as OutputFile::write() does.
  void write(std::span<const Aabb> boxes);

  /// @throws Error if a block is missing, and as OutputFile::commit() does.
  void commit();

  [[nodiscard]] const OutputFile& file() const noexcept { return file_; }

 private:
  bool is_aabbs_;
  std::uint32_t boxes_;
  std::uint64_t missing_blocks_;
  std::string block_;
  OutputFile file_;
};

/// Reads a recording block by block.
class RecordingReader {
 public:
  /// @throws Error, naming the file, if its extension is unknown, if it cannot be read, if it has no boxes or
  /// no frames, or if its size does not match its header.
  explicit RecordingReader(const std::filesystem::path& file);

  /// Per block; at least 1.
  [[nodiscard]] std::uint32_t boxes() const noexcept { return boxes_; }
  /// Without the initial state; at least 1.
  [[nodiscard]] std::uint32_t frames() const noexcept { return frames_; }

  /// Reads the next block: first the initial state, then each frame. Not to be called after the last one.
  /// @return Valid until the next call.
  /// @throws Error for a NaN, naming the file, the frame and the row.
  [[nodiscard]] std::span<const Aabb> next();

  /// Goes back to the initial state.
  void rewind();

 private:
  void read_aabbs_header();
  void read_npy_header();
  void check_size();

  std::string name_;  // of the file, for errors
  std::ifstream stream_;
  std::uint32_t boxes_ = 0;
  std::uint32_t frames_ = 0;
  BoundType bounds_;
  std::size_t corner_size_ = 0;  // bytes from a box's lower corner to its upper one; half a box
  std::streamoff data_begin_ = 0;
  std::uint64_t next_block_ = 0;
  std::string bytes_;  // of a block
  std::vector<Aabb> block_;
};

}  // namespace broadcl::cli
