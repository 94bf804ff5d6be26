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

/// Recordings of moving boxes. Block 0 is the initial state, then comes a block a frame; each has the same
/// n boxes. The extension of a file chooses its format:
///
/// `.aabbs`, that of Broadmark (Serpa and Rodrigues, "Broadmark: A Testing Framework for Broad-Phase
/// Collision Detection Algorithms"). All is little-endian: char[128] name of the scene, char[128] type of the
/// objects, int32 n, int32 frames, two int32 zeros, the box of the world; then 1 + frames blocks of n boxes.
/// A box is eight float32: min x, y, z, 0, max x, y, z, 0.
///
/// `.npy`: an array of shape (1 + frames, n, 6): min x, y, z, max x, y, z; float32, and for reading float64
/// too, which rounds outward, of either byte order.
namespace broadcl::cli {

/// What is known of a recording before its first block.
struct RecordingInfo {
  std::string scene;         ///< Only `.aabbs` keeps this, cut after 127 bytes.
  std::string objects;       ///< Their type; kept as `scene` is.
  Aabb world;                ///< What the objects are in; kept only by `.aabbs`.
  std::uint32_t boxes = 0;   ///< In each block: 1 to 2^31 - 1.
  std::uint32_t frames = 0;  ///< The initial state not counted: 1 to 2^31 - 1.
};

/// Writes a recording block by block; the file appears whole, at commit(), or not at all.
class RecordingWriter {
 public:
  /// @throws Error for an unknown extension, and where the file cannot be written.
  RecordingWriter(const std::filesystem::path& file, const RecordingInfo& info);

  /// Writes the next block: first the initial state, then each frame.
  /// @throws Error where there are not as many boxes, or as many blocks, as announced, and as
  /// OutputFile::write().
  void write(std::span<const Aabb> boxes);

  /// @throws Error where a block is missing, and as OutputFile::commit().
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
  /// @throws Error that names the file for an unknown extension, for what cannot be read or has no box or no
  /// frame, and for a file whose size is not what its header tells.
  explicit RecordingReader(const std::filesystem::path& file);

  /// In each block, at least 1.
  [[nodiscard]] std::uint32_t boxes() const noexcept { return boxes_; }
  /// The initial state not counted, at least 1.
  [[nodiscard]] std::uint32_t frames() const noexcept { return frames_; }

  /// Reads the next block: first the initial state, then each frame. Not to be called after the last one.
  /// @return Valid until the next call.
  /// @throws Error that names the file for a NaN, and names its frame and row.
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
  std::size_t corner_size_ = 0;  // bytes from a box's lower corner to its upper one, and on to the next box
  std::streamoff data_begin_ = 0;
  std::uint64_t next_block_ = 0;
  std::string bytes_;  // of a block
  std::vector<Aabb> block_;
};

}  // namespace broadcl::cli
