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
#include "scenes/recorded_frame.hpp"

/// Recordings of moving boxes, in one of three forms.
///
/// What BROADCL_RECORD asks for (docs/recording.md), whatever the file is called: objects that may come and
/// go, with ids and filters. Each frame is an update.
///
/// The extension selects the others, which have the same n boxes in each block; block 0 is the initial state,
/// then comes one block per frame:
///
/// `.aabbs`, the format of Broadmark (Serpa and Rodrigues, "Broadmark: A Testing Framework for Broad-Phase
/// Collision Detection Algorithms"). Everything is little-endian: char[128] name of the scene, char[128] type
/// of the objects, int32 n, int32 frames, two int32 zeros, the box of the world; then 1 + frames blocks of n
/// boxes. A box is eight float32: min x, y, z, 0, max x, y, z, 0.
///
/// `.npy`: an array of shape (1 + frames, n, 6): min x, y, z, max x, y, z. Written as float32; read as
/// float32 or float64, which is rounded outward, in either byte order.
namespace broadcl::cli {

/// What is known about a recording before its first block, if it is in one of the last two forms.
struct RecordingInfo {
  std::string scene;         ///< Its name; stored only by `.aabbs`, truncated to 127 bytes.
  std::string objects;       ///< Their type; stored like `scene`.
  Aabb world;                ///< The bounds of the world; stored only by `.aabbs`.
  std::uint32_t boxes = 0;   ///< Per block: 1 to 2^31 - 1.
  std::uint32_t frames = 0;  ///< Without the initial state: 1 to 2^31 - 1.
};

/// Writes a recording in one of the last two forms, block by block; the file appears whole, at commit(), or
/// not at all.
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

/// Reads a recording frame by frame.
class RecordingReader {
 public:
  /// @throws Error, naming the file, if its form is unknown, if it cannot be read, if it has no boxes or no
  /// frames, or if its size does not match what it says.
  explicit RecordingReader(const std::filesystem::path& file);

  /// The most in a frame; at least 1, unless all frames of the first form are empty.
  [[nodiscard]] std::uint32_t boxes() const noexcept { return boxes_; }
  /// Without the initial state; at least 1.
  [[nodiscard]] std::uint32_t frames() const noexcept { return frames_; }
  /// Whether an initial state comes before the frames.
  [[nodiscard]] bool has_initial_state() const noexcept { return !is_recorded_; }
  /// Whether frames have `boxes64`.
  [[nodiscard]] bool is_double() const noexcept { return is_recorded_ && bounds_.is_double; }
  /// Config::distance.
  [[nodiscard]] double distance() const noexcept { return distance_; }
  /// What to tell of a file that ends within a frame, which is left out; "" if none does.
  [[nodiscard]] std::string note_of_cut() const;

  /// Reads the next frame: first the initial state, if there is one. Not to be called after the last one.
  /// @return Valid until the next call.
  /// @throws Error, naming the file and the frame, for a NaN, and for what cannot be.
  [[nodiscard]] const scenes::RecordedFrame& next();

  /// Goes back to the beginning.
  void rewind();

 private:
  void read_aabbs_header();
  void read_npy_header();
  void check_size();
  void read_block();
  void read_recorded_header();
  void find_frames();
  void read_frame();
  void find_added(const std::vector<std::uint32_t>& before);

  std::string name_;  // of the file, for errors
  std::ifstream stream_;
  bool is_recorded_ = false;
  bool is_cut_ = false;
  double distance_ = 0;
  std::uint32_t boxes_ = 0;
  std::uint32_t frames_ = 0;
  BoundType bounds_;
  std::size_t corner_size_ = 0;  // bytes from a box's lower corner to its upper one; half a box
  std::streamoff data_begin_ = 0;
  std::uint64_t next_frame_ = 0;
  std::string bytes_;  // of a frame
  scenes::RecordedFrame frame_;
};

}  // namespace broadcl::cli
