#include "cli/recording.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <broadcl/error.hpp>
#include <limits>
#include <string_view>

#include "cli/input_file.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr std::size_t name_size = 128;
constexpr std::size_t aabbs_header_size = 304;
constexpr std::uint64_t box_columns = 6;
constexpr std::uint32_t most = std::numeric_limits<std::int32_t>::max();

/// Whether the format is Broadmark's; otherwise it is NumPy's.
bool is_aabbs(const std::filesystem::path& file) {
  if (file.extension() == ".aabbs") return true;
  if (file.extension() == ".npy") return false;
  throw Error(quoted(file) +
              " does not have the extension of a recording; name a file that ends in .aabbs or .npy");
}

void append(std::string& bytes, std::uint32_t value) {
  for (unsigned shift = 0; shift < 32; shift += 8) bytes += static_cast<char>((value >> shift) & 0xff);
}

void append(std::string& bytes, float value) {
  append(bytes, std::bit_cast<std::uint32_t>(value));
}

/// @param padded Append a zero to each corner.
void append(std::string& bytes, const Aabb& box, bool padded) {
  for (const std::array<float, 3>& corner : {box.lower, box.upper}) {
    for (const float bound : corner) append(bytes, bound);
    if (padded) append(bytes, 0.0F);
  }
}

std::int32_t load_int32(const char* from) {
  std::uint32_t value = 0;
  for (unsigned i = 0; i < 4; ++i) value |= std::uint32_t{static_cast<unsigned char>(from[i])} << (8 * i);
  return std::bit_cast<std::int32_t>(value);
}

std::string aabbs_header(const RecordingInfo& info) {
  std::string bytes;
  for (const std::string* name : {&info.scene, &info.objects}) {
    bytes += name->substr(0, name_size - 1);
    bytes.resize((bytes.size() / name_size + 1) * name_size);
  }
  for (const std::uint32_t value : {info.boxes, info.frames, 0U, 0U}) append(bytes, value);
  append(bytes, info.world, true);
  return bytes;
}

}  // namespace

RecordingWriter::RecordingWriter(const std::filesystem::path& file, const RecordingInfo& info)
    : is_aabbs_(is_aabbs(file)),
      boxes_(info.boxes),
      missing_blocks_(std::uint64_t{1} + info.frames),
      file_(file) {
  file_.write(is_aabbs_ ? aabbs_header(info) : npy_header("<f4", {missing_blocks_, boxes_, box_columns}));
}

void RecordingWriter::write(std::span<const Aabb> boxes) {
  if (boxes.size() != boxes_ || missing_blocks_ == 0) {
    throw Error("a recording got more frames, or another number of boxes, than was announced");
  }
  block_.clear();
  for (const Aabb& box : boxes) append(block_, box, is_aabbs_);
  file_.write(block_);
  --missing_blocks_;
}

void RecordingWriter::commit() {
  if (missing_blocks_ != 0) throw Error("a recording got fewer frames than was announced");
  file_.commit();
}

RecordingReader::RecordingReader(const std::filesystem::path& file) : name_(quoted(file)) {
  const bool aabbs = is_aabbs(file);
  std::error_code ignored;
  // (To open a pipe could take forever.)
  if (std::filesystem::is_other(std::filesystem::status(file, ignored))) {
    throw Error(name_ + " is not a regular file, and a recording is read twice; save it to a file");
  }
  stream_ = open_input(file);
  try {
    if (aabbs) {
      read_aabbs_header();
    } else {
      read_npy_header();
    }
    check_size();
  } catch (const Error& error) {
    throw Error("cannot use " + name_ + ": " + error.what());
  }
}

void RecordingReader::read_aabbs_header() {
  std::array<char, aabbs_header_size> header{};
  stream_.read(header.data(), header.size());
  if (stream_.gcount() < std::streamsize{aabbs_header_size}) {
    throw Error("it ends within its header of " + std::to_string(aabbs_header_size) + " bytes");
  }
  const char* const numbers = header.data() + 2 * name_size;
  const std::int32_t boxes = load_int32(numbers);
  const std::int32_t frames = load_int32(numbers + 4);
  if (load_int32(numbers + 8) != 0 || load_int32(numbers + 12) != 0) {
    throw Error("it is not a recording of Broadmark's: the two zeros in its header are missing");
  }
  if (boxes < 1) throw Error("its header says " + std::to_string(boxes) + " boxes; at least 1 is needed");
  if (frames < 1) {
    throw Error("its header says " + std::to_string(frames) + " frames; at least 1 is needed");
  }
  boxes_ = static_cast<std::uint32_t>(boxes);
  frames_ = static_cast<std::uint32_t>(frames);
  corner_size_ = 4 * bounds_.size();
}

void RecordingReader::read_npy_header() {
  const NpyHeader header = cli::read_npy_header(stream_);
  const std::string shape = "its shape is " + header.shape_text();
  if (header.shape.size() != 3 || header.shape[2] != box_columns) {
    throw Error(shape + "; (frames, n, 6) is needed: min x, y, z, max x, y, z");
  }
  if (header.fortran_order) {
    throw Error("it is in Fortran order; save it again in C order, with numpy.ascontiguousarray");
  }
  const std::uint64_t blocks = header.shape[0];
  if (blocks < 2) throw Error(shape + "; an initial state and at least one frame are needed");
  if (header.shape[1] < 1) throw Error(shape + "; at least one box is needed");
  if (blocks - 1 > most || header.shape[1] > most) throw Error(shape + ", which is too large");
  boxes_ = static_cast<std::uint32_t>(header.shape[1]);
  frames_ = static_cast<std::uint32_t>(blocks - 1);
  bounds_ = header.bounds;
  corner_size_ = 3 * bounds_.size();
}

void RecordingReader::check_size() {
  data_begin_ = stream_.tellg();
  stream_.seekg(0, std::ios::end);
  const auto there = static_cast<std::uint64_t>(stream_.tellg() - data_begin_);
  const std::uint64_t boxes = (std::uint64_t{1} + frames_) * boxes_;  // below 2^62, but their bytes are not
  const std::uint64_t box_size = 2 * corner_size_;
  const std::string needed = counted(boxes_, "box") + ", initially and in each of " +
                             counted(frames_, "frame") + ", need " + std::to_string(box_size) +
                             " bytes per box; it has " + std::to_string(there) + " bytes of boxes";
  if (boxes > there / box_size) throw Error("it is truncated: " + needed);
  if (boxes * box_size < there) throw Error("it has bytes after its boxes: " + needed);
  bytes_.resize(std::size_t{boxes_} * box_size);
  block_.resize(boxes_);
  rewind();
}

std::span<const Aabb> RecordingReader::next() {
  if (!stream_.read(bytes_.data(), static_cast<std::streamsize>(bytes_.size()))) {
    throw Error("cannot read " + name_ + " to its end; has it changed in the meantime?");
  }
  const char* lower = bytes_.data();
  for (Aabb& box : block_) {
    box = load_box(bounds_, lower, lower + corner_size_, bounds_.size());
    lower += 2 * corner_size_;
  }
  const auto nan = std::find_if(block_.begin(), block_.end(), has_nan);
  if (nan != block_.end()) {
    throw Error("cannot use " + name_ + ": frame " + std::to_string(next_block_) + ", row " +
                std::to_string(nan - block_.begin()) +
                " holds a NaN (both count from 0, frame 0 is the initial state); give it bounds");
  }
  ++next_block_;
  return block_;
}

void RecordingReader::rewind() {
  stream_.clear();
  stream_.seekg(data_begin_);
  next_block_ = 0;
}

}  // namespace broadcl::cli
