#include "cli/recording.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <broadcl/error.hpp>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <string_view>
#include <type_traits>
#include <utility>

#include "cli/input_file.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr std::string_view recorded_magic = "BroadCL\n";
constexpr std::size_t recorded_header_size = 32;
constexpr std::string_view frame_magic = "FRAM";
constexpr std::size_t frame_header_size = 16;
constexpr std::size_t name_size = 128;
constexpr std::size_t aabbs_header_size = 304;
constexpr std::uint64_t box_columns = 6;
constexpr std::uint32_t most = std::numeric_limits<std::int32_t>::max();

/// Whether the format is Broadmark's; otherwise it is NumPy's.
bool is_aabbs(const std::filesystem::path& file) {
  if (file.extension() == ".aabbs") return true;
  if (file.extension() == ".npy") return false;
  throw Error(quoted(file) +
              " is not a recording of BROADCL_RECORD, nor does it have the extension of another one; name a "
              "file that ends in .aabbs or .npy");
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

template <class Number>
Number load(const char* from) {
  std::array<char, sizeof(Number)> bytes{};
  std::copy_n(from, bytes.size(), bytes.begin());
  if constexpr (std::endian::native == std::endian::big) std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<Number>(bytes);
}

/// Reads numbers one after the other.
class Numbers {
 public:
  explicit Numbers(std::string_view bytes) : bytes_(bytes) {}

  /// @throws Error if there is no more.
  template <class Number>
  Number next() {
    if (bytes_.size() < sizeof(Number)) throw Error("its lists are longer than the frame");
    const auto number = load<Number>(bytes_.data());
    bytes_.remove_prefix(sizeof(Number));
    return number;
  }
  /// The length of a list.
  /// @param bytes Of each element.
  /// @throws Error if there is no memory for so many in the frame.
  std::uint32_t next_count(std::size_t bytes) {
    const auto count = next<std::uint32_t>();
    if (count > bytes_.size() / bytes) throw Error("its lists are longer than the frame");
    return count;
  }
  [[nodiscard]] bool at_end() const noexcept { return bytes_.empty(); }

 private:
  std::string_view bytes_;
};

/// Reads ids.
/// @throws Error unless they ascend.
std::vector<std::uint32_t> load_ids(Numbers& numbers, std::uint32_t count) {
  std::vector<std::uint32_t> ids(count);
  for (std::uint32_t& id : ids) id = numbers.next<std::uint32_t>();
  if (std::ranges::adjacent_find(ids, std::ranges::greater_equal()) != ids.end())
    throw Error("its ids do not ascend");
  return ids;
}

template <class Box>
std::vector<Box> load_boxes(Numbers& numbers, const std::vector<std::uint32_t>& ids) {
  std::vector<Box> boxes(ids.size());
  for (Box& box : boxes) {
    for (auto* const corner : {&box.lower, &box.upper}) {
      for (auto& bound : *corner) bound = numbers.next<std::remove_reference_t<decltype(bound)>>();
    }
  }
  const auto nan = std::find_if(boxes.begin(), boxes.end(), [](const Box& box) { return has_nan(box); });
  if (nan != boxes.end()) {
    throw Error("the box of the id " + std::to_string(ids[static_cast<std::size_t>(nan - boxes.begin())]) +
                " has a NaN bound");
  }
  return boxes;
}

/// @throws Error unless each is of an object of the frame, and the ids ascend.
template <class Value>
void refuse_unknown(const std::vector<scenes::RecordedFrame::Of<Value>>& values,
                    const std::vector<std::uint32_t>& ids) {
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (k > 0 && values[k - 1].id >= values[k].id) throw Error("its ids do not ascend");
    if (!std::ranges::binary_search(ids, values[k].id)) {
      throw Error("it has a filter or a reach of the id " + std::to_string(values[k].id) +
                  ", which no object has");
    }
  }
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
  std::error_code ignored;
  // (To open a pipe could take forever.)
  if (std::filesystem::is_other(std::filesystem::status(file, ignored))) {
    throw Error(name_ + " is not a regular file, and a recording is read twice; save it to a file");
  }
  stream_ = open_input(file);
  std::string first(recorded_magic.size(), '\0');
  is_recorded_ =
      stream_.read(first.data(), static_cast<std::streamsize>(first.size())) && first == recorded_magic;
  stream_.clear();
  stream_.seekg(0);
  const bool aabbs = !is_recorded_ && is_aabbs(file);
  try {
    if (is_recorded_) {
      read_recorded_header();
    } else {
      aabbs ? read_aabbs_header() : read_npy_header();
      check_size();
    }
  } catch (const Error& error) {
    throw Error("cannot use " + name_ + ": " + error.what());
  }
}

void RecordingReader::read_recorded_header() {
  std::string header(recorded_header_size, '\0');
  if (!stream_.read(header.data(), static_cast<std::streamsize>(header.size()))) {
    throw Error("it ends within its header of " + std::to_string(recorded_header_size) + " bytes");
  }
  Numbers numbers(std::string_view(header).substr(recorded_magic.size()));
  const auto version = numbers.next<std::uint32_t>();
  const auto precision = numbers.next<std::uint32_t>();
  distance_ = numbers.next<double>();
  if (version != 1) {
    throw Error("its version is " + std::to_string(version) + ", and this program reads version 1; use a " +
                "newer one");
  }
  if (precision != 32 && precision != 64)
    throw Error("its precision is " + std::to_string(precision) + "; 32 or 64 is needed");
  if (!(distance_ >= 0 && std::isfinite(distance_)) || numbers.next<std::uint64_t>() != 0)
    throw Error("its header is malformed");
  bounds_.is_double = precision == 64;
  data_begin_ = recorded_header_size;
  find_frames();
}

/// Counts the frames, which are read later.
void RecordingReader::find_frames() {
  stream_.seekg(0, std::ios::end);
  const auto end = static_cast<std::uint64_t>(stream_.tellg());
  auto begin = static_cast<std::uint64_t>(data_begin_);
  while (begin < end) {
    if (frames_ == most) throw Error("it has too many frames");
    std::string header(std::min<std::uint64_t>(frame_header_size, end - begin), '\0');
    stream_.seekg(static_cast<std::streamoff>(begin));
    stream_.read(header.data(), static_cast<std::streamsize>(header.size()));
    if (!frame_magic.starts_with(std::string_view(header).substr(0, frame_magic.size()))) {
      throw Error("no frame begins at byte " + std::to_string(begin));
    }
    is_cut_ = header.size() < frame_header_size;
    if (is_cut_) break;
    const auto boxes = load<std::uint32_t>(header.data() + 4);
    const auto rest = load<std::uint64_t>(header.data() + 8);
    begin += frame_header_size;
    is_cut_ = rest > end - begin;
    if (is_cut_) break;
    if (boxes > rest / (4 + 6 * bounds_.size())) {
      throw Error("frame " + std::to_string(frames_) + " (the first is 0) is too short for " +
                  counted(boxes, "box"));
    }
    begin += rest;
    boxes_ = std::max(boxes_, boxes);
    ++frames_;
  }
  if (frames_ == 0) throw Error("it has no complete frame");
  rewind();
}

void RecordingReader::read_frame() {
  std::array<char, frame_header_size> header{};
  stream_.read(header.data(), header.size());
  bytes_.resize(load<std::uint64_t>(header.data() + 8));
  if (!stream_.read(bytes_.data(), static_cast<std::streamsize>(bytes_.size()))) {
    throw Error("it cannot be read; has it changed in the meantime?");
  }
  Numbers numbers(bytes_);
  const std::vector<std::uint32_t> before = std::move(frame_.ids);
  frame_ = {};
  frame_.ids = load_ids(numbers, load<std::uint32_t>(header.data() + 4));
  // A broad phase has memory for all ids below the highest, which is seldom far above the number of objects.
  constexpr std::uint64_t most_free = std::uint64_t{1} << 22U;
  if (!frame_.ids.empty() && frame_.ids.back() >= most_free + std::uint64_t{4} * boxes_) {
    throw Error("the id " + std::to_string(frame_.ids.back()) + " is too high for so few objects");
  }
  if (bounds_.is_double) {
    frame_.boxes64 = load_boxes<Aabb64>(numbers, frame_.ids);
  } else {
    frame_.boxes = load_boxes<Aabb>(numbers, frame_.ids);
  }
  frame_.filters.resize(numbers.next_count(20));
  for (auto& [id, filter] : frame_.filters) {
    id = numbers.next<std::uint32_t>();
    for (std::uint32_t* const part : {&filter.group, &filter.mask, &filter.body, &filter.world})
      *part = numbers.next<std::uint32_t>();
  }
  refuse_unknown(frame_.filters, frame_.ids);
  frame_.reaches.resize(numbers.next_count(4 + bounds_.size()));
  for (auto& [id, reach] : frame_.reaches) {
    id = numbers.next<std::uint32_t>();
    reach = bounds_.is_double ? numbers.next<double>() : static_cast<double>(numbers.next<float>());
  }
  refuse_unknown(frame_.reaches, frame_.ids);
  frame_.gone = load_ids(numbers, numbers.next_count(4));
  const auto has_exclusions = numbers.next<std::uint32_t>();
  if (has_exclusions > 1) throw Error("it is malformed where exclusions begin");
  if (has_exclusions == 1) {
    frame_.exclusions.emplace(numbers.next_count(8));
    for (auto& [a, b] : *frame_.exclusions) {
      a = numbers.next<std::uint32_t>();
      b = numbers.next<std::uint32_t>();
    }
  }
  if (!numbers.at_end()) throw Error("it has bytes after its lists");
  find_added(before);
}

/// @param before The ids of the last frame.
void RecordingReader::find_added(const std::vector<std::uint32_t>& before) {
  if (!std::ranges::includes(before, frame_.gone))
    throw Error("an object is removed that was not in the frame before");
  std::vector<std::uint32_t> stay;
  std::ranges::set_difference(before, frame_.gone, std::back_inserter(stay));
  if (!std::ranges::includes(frame_.ids, stay))
    throw Error("an object of the frame before is missing and was not removed");
  std::ranges::set_difference(frame_.ids, stay, std::back_inserter(frame_.added));
}

void RecordingReader::read_aabbs_header() {
  std::array<char, aabbs_header_size> header{};
  stream_.read(header.data(), header.size());
  if (stream_.gcount() < std::streamsize{aabbs_header_size}) {
    throw Error("it ends within its header of " + std::to_string(aabbs_header_size) + " bytes");
  }
  const char* const numbers = header.data() + 2 * name_size;
  const auto boxes = load<std::int32_t>(numbers);
  const auto frames = load<std::int32_t>(numbers + 4);
  if (load<std::int32_t>(numbers + 8) != 0 || load<std::int32_t>(numbers + 12) != 0) {
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
  frame_.boxes.resize(boxes_);
  frame_.ids.resize(boxes_);
  std::iota(frame_.ids.begin(), frame_.ids.end(), 0U);
  rewind();
}

void RecordingReader::read_block() {
  if (!stream_.read(bytes_.data(), static_cast<std::streamsize>(bytes_.size()))) {
    throw Error("cannot read " + name_ + " to its end; has it changed in the meantime?");
  }
  const char* lower = bytes_.data();
  for (Aabb& box : frame_.boxes) {
    box = load_box(bounds_, lower, lower + corner_size_, bounds_.size());
    lower += 2 * corner_size_;
  }
  const auto nan = std::find_if(frame_.boxes.begin(), frame_.boxes.end(), has_nan);
  if (nan != frame_.boxes.end()) {
    throw Error("cannot use " + name_ + ": frame " + std::to_string(next_frame_) + ", row " +
                std::to_string(nan - frame_.boxes.begin()) +
                " holds a NaN (both count from 0, frame 0 is the initial state); give it bounds");
  }
  frame_.added = next_frame_ == 0 ? frame_.ids : std::vector<std::uint32_t>();
}

const scenes::RecordedFrame& RecordingReader::next() {
  if (!is_recorded_) {
    read_block();
  } else {
    try {
      read_frame();
    } catch (const Error& error) {
      throw Error("cannot use " + name_ + ": frame " + std::to_string(next_frame_) +
                  " (the first is 0): " + error.what());
    }
  }
  ++next_frame_;
  return frame_;
}

std::string RecordingReader::note_of_cut() const {
  if (!is_cut_) return "";
  return "The recording ends within frame " + std::to_string(frames_) +
         ", which is left out: the program that wrote it was stopped, or its disk was full.\n";
}

void RecordingReader::rewind() {
  stream_.clear();
  stream_.seekg(data_begin_);
  next_frame_ = 0;
  if (is_recorded_) frame_ = {};
}

}  // namespace broadcl::cli
