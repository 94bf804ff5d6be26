#include "cli/recording.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "environment.hpp"
#include "expect_error.hpp"
#include "npy_bytes.hpp"

namespace broadcl::cli {
namespace {

namespace fs = std::filesystem;
using test::bytes_of;
using test::error_of;
using test::little_endian;
using test::npy;
using test::swapped_bytes_of;

using Blocks = std::vector<std::vector<Aabb>>;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

/// The initial state and two frames of two boxes.
const Blocks three_blocks = {{{{0, 1, 2}, {3, 4, 5}}, {{-6, -5, -4}, {-3, -2, -1}}},
                             {{{0.5, 1, 2}, {3, 4, 5}}, {{-infinity, 0, 0}, {infinity, 0, 0}}},
                             {{{1, 1, 1}, {0, 0, 0}}, {{7, 7, 7}, {8, 8, 8}}}};
const RecordingInfo info = {
    .scene = "free-fall", .objects = "cubes", .world = {{-9, -9, -9}, {9, 9, 9}}, .boxes = 2, .frames = 2};

std::string padded(const std::string& name) {
  return name + std::string(128 - name.size(), '\0');
}

std::string aabbs_header(std::uint32_t boxes, std::uint32_t frames, std::uint32_t third = 0,
                         std::uint32_t fourth = 0) {
  return padded("free-fall") + padded("cubes") + little_endian(boxes, 4) + little_endian(frames, 4) +
         little_endian(third, 4) + little_endian(fourth, 4) +
         bytes_of(std::vector<float>{-9, -9, -9, 0, 9, 9, 9, 0});
}

/// The numbers of all boxes; if corners are padded, `padding` follows each.
std::vector<float> numbers_of(const Blocks& blocks, bool is_padded, float padding = 0) {
  std::vector<float> numbers;
  for (const std::vector<Aabb>& block : blocks) {
    for (const Aabb& box : block) {
      for (const auto& corner : {box.lower, box.upper}) {
        numbers.insert(numbers.end(), corner.begin(), corner.end());
        if (is_padded) numbers.push_back(padding);
      }
    }
  }
  return numbers;
}

std::string aabbs(const Blocks& blocks, float padding = 0) {
  return aabbs_header(static_cast<std::uint32_t>(blocks.front().size()),
                      static_cast<std::uint32_t>(blocks.size() - 1)) +
         bytes_of(numbers_of(blocks, true, padding));
}

std::string dictionary(const std::string& dtype, const std::string& shape,
                       const std::string& fortran = "False") {
  return "{'descr': '" + dtype + "', 'fortran_order': " + fortran + ", 'shape': " + shape + ", }";
}

class Recording : public testing::Test {
 protected:
  [[nodiscard]] fs::path path(const std::string& name) const { return folder_.path() / name; }

  [[nodiscard]] std::string bytes(const std::string& name) const {
    std::ifstream stream(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  void save(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
  }

  /// Writes three_blocks.
  void record(const std::string& name) const {
    RecordingWriter writer(path(name), info);
    for (const std::vector<Aabb>& block : three_blocks) writer.write(block);
    writer.commit();
  }

  static Blocks rest_of(RecordingReader& reader) {
    Blocks blocks;
    for (std::uint32_t block = reader.has_initial_state() ? 0 : 1; block <= reader.frames(); ++block) {
      blocks.push_back(reader.next().boxes);
    }
    return blocks;
  }

  [[nodiscard]] Blocks read(const std::string& name) const {
    RecordingReader reader(path(name));
    return rest_of(reader);
  }

  /// The error that a file with these bytes causes when it is read to its end.
  [[nodiscard]] std::string refusal_of(const std::string& name, const std::string& bytes) const {
    save(name, bytes);
    return error_of([&] { (void)read(name); });
  }

  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path())) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }

 private:
  test::ScopedFolder folder_;
};

TEST_F(Recording, AabbsIsAsBroadmarkHasIt) {
  record("x.aabbs");
  const std::string file = bytes("x.aabbs");
  EXPECT_EQ(file.size(), 304U + 3 * 2 * 32);
  EXPECT_EQ(file, aabbs(three_blocks));
}

TEST_F(Recording, NpyIsAsNumpyHasIt) {
  record("x.npy");
  const std::string data = bytes_of(numbers_of(three_blocks, false));
  const std::string file = bytes("x.npy");
  EXPECT_TRUE(file.ends_with("\n" + data));
  const std::string header = file.substr(0, file.size() - data.size());
  EXPECT_EQ(header.size() % 64, 0U);
  EXPECT_TRUE(header.substr(10).starts_with(dictionary("<f4", "(3, 2, 6)") + " ")) << header;
}

TEST_F(Recording, ComesBackInEitherFormat) {
  for (const std::string name : {"x.aabbs", "x.npy"}) {
    record(name);
    RecordingReader reader(path(name));
    EXPECT_EQ(reader.boxes(), 2U);
    EXPECT_EQ(reader.frames(), 2U);
    EXPECT_EQ(rest_of(reader), three_blocks) << name;
    reader.rewind();
    EXPECT_EQ(rest_of(reader), three_blocks) << name;
  }
}

TEST_F(Recording, LongNamesAreCut) {
  RecordingInfo long_info = info;
  long_info.scene = std::string(127, 's') + "cut";
  long_info.objects = std::string(128, 'o');
  RecordingWriter writer(path("x.aabbs"), long_info);
  for (const std::vector<Aabb>& block : three_blocks) writer.write(block);
  writer.commit();
  const std::string file = bytes("x.aabbs");
  EXPECT_EQ(file.substr(0, 256), padded(std::string(127, 's')) + padded(std::string(127, 'o')));
  EXPECT_EQ(file.substr(256), aabbs(three_blocks).substr(256));
}

TEST_F(Recording, AppearsWholeOrNotAtAll) {
  for (const std::string name : {"x.aabbs", "x.npy"}) {
    {
      RecordingWriter writer(path(name), info);
      for (const std::vector<Aabb>& block : three_blocks) writer.write(block);
    }
    EXPECT_TRUE(files().empty());
    save(name, "old");
    {
      RecordingWriter writer(path(name), info);
      writer.write(three_blocks[0]);
      EXPECT_THAT(error_of([&] { writer.commit(); }), testing::HasSubstr("fewer frames"));
    }
    EXPECT_EQ(bytes(name), "old");
    EXPECT_EQ(files(), std::vector{name});
    fs::remove(path(name));
  }
}

TEST_F(Recording, TakesWhatWasAnnounced) {
  RecordingWriter writer(path("x.npy"), info);
  EXPECT_THROW(writer.write(std::vector<Aabb>(1)), Error);
  EXPECT_THROW(writer.write(std::vector<Aabb>(3)), Error);
  for (const std::vector<Aabb>& block : three_blocks) writer.write(block);
  EXPECT_THROW(writer.write(three_blocks[0]), Error);
}

TEST_F(Recording, TheExtensionIsTheFormat) {
  for (const std::string name : {"x.npz", "x", ".npy", "x.AABBS"}) {
    for (const std::string& error : {error_of([&] { (void)RecordingWriter(path(name), info); }),
                                     refusal_of(name, aabbs(three_blocks))}) {
      EXPECT_THAT(error, testing::HasSubstr(name));
      EXPECT_THAT(error, testing::HasSubstr("ends in .aabbs or .npy"));
    }
  }
}

TEST_F(Recording, WhatPadsABoxIsPassedOver) {
  save("x.aabbs", aabbs(three_blocks, nan));
  EXPECT_EQ(read("x.aabbs"), three_blocks);
}

TEST_F(Recording, NpyOfEitherByteOrderAndPrecision) {
  const std::vector<float> numbers = numbers_of(three_blocks, false);
  const std::vector<double> doubles(numbers.begin(), numbers.end());
  const std::string shape = "(3, 2, 6)";
  for (const std::string& file : {npy(dictionary("<f4", shape), bytes_of(numbers)),
                                  npy(dictionary(">f4", shape), swapped_bytes_of(numbers), 2),
                                  npy(dictionary("<f8", shape), bytes_of(doubles), 3),
                                  npy(dictionary(">f8", shape), swapped_bytes_of(doubles))}) {
    save("x.npy", file);
    EXPECT_EQ(read("x.npy"), three_blocks) << file.substr(0, 40);
  }
}

TEST_F(Recording, Float64RoundsOutwardAndEmptyStaysEmpty) {
  const std::vector<double> numbers = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0, 0, 0.0999999999, 1, 1};
  save("x.npy", npy(dictionary("<f8", "(2, 1, 6)"), bytes_of(numbers)));
  const Blocks blocks = read("x.npy");
  const float above = 0.1F;
  const float below = std::nextafter(0.1F, 0.0F);
  ASSERT_GT(static_cast<double>(above), 0.1);
  EXPECT_EQ(blocks[0][0], (Aabb{{below, below, below}, {above, above, above}}));
  EXPECT_TRUE(is_empty(blocks[1][0]));
}

TEST_F(Recording, NanNamesFrameAndRow) {
  Blocks blocks = three_blocks;
  blocks[2][1].upper[2] = nan;
  for (const std::string& error :
       {refusal_of("x.aabbs", aabbs(blocks)),
        refusal_of("x.npy", npy(dictionary("<f4", "(3, 2, 6)"), bytes_of(numbers_of(blocks, false))))}) {
    EXPECT_THAT(error, testing::HasSubstr("x."));
    EXPECT_THAT(error, testing::HasSubstr("frame 2, row 1 holds a NaN"));
  }
}

TEST_F(Recording, WhatIsWrongWithAFileIsReported) {
  const std::string good = aabbs(three_blocks);
  const std::string numbers = bytes_of(numbers_of(three_blocks, false));
  const std::string array = npy(dictionary("<f4", "(3, 2, 6)"), numbers);
  const auto array_of = [&](const std::string& shape) { return npy(dictionary("<f4", shape), numbers); };
  struct Bad {
    std::string name;
    std::string bytes;
    std::string message;
  };
  const std::vector<Bad> bad_files = {
      {"x.aabbs", "", "ends within its header"},
      {"x.aabbs", good.substr(0, 303), "ends within its header"},
      {"x.aabbs", good.substr(0, 304),
       "it is truncated: 2 boxes, initially and in each of 2 frames, need 32 bytes per box; it "
       "has 0 bytes"},
      {"x.aabbs", good.substr(0, good.size() - 1), "it has 191 bytes"},
      {"x.aabbs", aabbs_header(1, 1), "it is truncated: 1 box, initially and in each of 1 frame, need"},
      {"x.aabbs", good + "x", "bytes after its boxes"},
      {"x.aabbs", array, "ends within its header"},
      {"x.aabbs", array + std::string(304, 'x'), "two zeros in its header"},
      {"x.aabbs", aabbs_header(2, 2, 1, 0) + good.substr(304), "two zeros in its header"},
      {"x.aabbs", aabbs_header(2, 2, 0, 1) + good.substr(304), "two zeros in its header"},
      {"x.aabbs", aabbs_header(0, 2), "0 boxes"},
      {"x.aabbs", aabbs_header(0xfffffffb, 2) + good.substr(304), "-5 boxes"},
      {"x.aabbs", aabbs_header(2, 0) + good.substr(304, 64), "0 frames"},
      {"x.aabbs", aabbs_header(2, 0x80000000) + good.substr(304), "-2147483648 frames"},
      {"x.aabbs", aabbs_header(0x7fffffff, 0x7fffffff) + good.substr(304),
       "it is truncated: 2147483647 boxes"},
      {"x.aabbs", aabbs_header(0x40000000, 0x1fffffff) + good.substr(304),
       "it is truncated"},  // 2^64 bytes in total
      {"x.npy", good, "magic bytes"},
      {"x.npy", array.substr(0, array.size() - 1),
       "it is truncated: 2 boxes, initially and in each of 2 frames, need 24"},
      {"x.npy", array + "x", "bytes after its boxes"},
      {"x.npy", npy(dictionary("<f4", "(3, 2, 6)", "True"), numbers), "Fortran order"},
      {"x.npy", array_of("(6, 6)"), "(frames, n, 6) is needed"},
      {"x.npy", array_of("(3, 6, 2)"), "(frames, n, 6) is needed"},
      {"x.npy", array_of("(1, 3, 2, 6)"), "(frames, n, 6) is needed"},
      {"x.npy", array_of("(1, 6, 6)"), "at least one frame"},
      {"x.npy", array_of("(0, 2, 6)"), "at least one frame"},
      {"x.npy", array_of("(3, 0, 6)"), "at least one box"},
      {"x.npy", array_of("(3, 4294967296, 6)"), "too large"},
      {"x.npy", array_of("(18446744073709551615, 2, 6)"), "too large"},
      {"x.npy", array_of("(2147483648, 2147483647, 6)"), "it is truncated"},
  };
  for (const Bad& bad : bad_files) {
    const std::string error = refusal_of(bad.name, bad.bytes);
    EXPECT_THAT(error, testing::HasSubstr("'" + path(bad.name).string() + "'"));
    EXPECT_THAT(error, testing::HasSubstr(bad.message));
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }
}

/// A recording of BROADCL_RECORD, in parts that a test can replace.
struct Recorded {
  std::string magic = "BroadCL\n";
  std::uint32_t version = 1;
  std::uint32_t precision = 32;
  double distance = 0;
  std::uint64_t zero = 0;
  std::uint32_t count = 2;
  std::vector<std::uint32_t> ids = {3, 5};
  std::vector<float> numbers = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
  std::vector<std::uint32_t> filter = {1, 5, 1, 2, 3, 4};  // their number, then those of the object 5
  std::uint32_t reaches = 1;
  std::uint32_t reach_id = 3;
  std::vector<std::uint32_t> gone = {0};
  std::vector<std::uint32_t> exclusions = {1, 1, 3, 5};

  [[nodiscard]] std::string header() const {
    return magic + little_endian(version, 4) + little_endian(precision, 4) + test::bytes_of(distance) +
           little_endian(zero, 8);
  }
  [[nodiscard]] std::string frame(const std::string& more = "") const {
    const auto words = [](const std::vector<std::uint32_t>& all) {
      std::string bytes;
      for (const std::uint32_t number : all) bytes += little_endian(number, 4);
      return bytes;
    };
    const std::string rest = words(ids) + bytes_of(numbers) + words(filter) + words({reaches, reach_id}) +
                             test::bytes_of(0.5F) + words(gone) + words(exclusions) + more;
    return "FRAM" + little_endian(count, 4) + little_endian(rest.size(), 8) + rest;
  }
};

template <class Edit>
std::string recorded(const Edit& edit) {
  Recorded file;
  edit(file);
  return file.header() + file.frame();
}

TEST_F(Recording, WhatAProgramRecordedIsRead) {
  Recorded second;
  second.ids = {5, 7};
  second.gone = {1, 3};
  second.exclusions = {0};
  second.reach_id = 7;
  save("x", Recorded().header() + Recorded().frame() + second.frame());
  RecordingReader reader(path("x"));
  EXPECT_EQ(reader.frames(), 2U);
  EXPECT_EQ(reader.boxes(), 2U);
  EXPECT_FALSE(reader.has_initial_state() || reader.is_double() || !reader.note_of_cut().empty());
  scenes::RecordedFrame frame = reader.next();
  EXPECT_EQ(frame.ids, (std::vector<std::uint32_t>{3, 5}));
  EXPECT_EQ(frame.added, frame.ids);
  EXPECT_EQ(frame.boxes[1], (Aabb{{2, 2, 2}, {3, 3, 3}}));
  EXPECT_EQ(frame.filters.at(0).value, (Filter{.group = 1, .mask = 2, .body = 3, .world = 4}));
  EXPECT_EQ(frame.reaches.at(0).value, 0.5);
  EXPECT_EQ(frame.exclusions, (std::vector<Pair>{{3, 5}}));
  frame = reader.next();
  EXPECT_EQ(frame.added, std::vector<std::uint32_t>{7});
  EXPECT_EQ(frame.gone, std::vector<std::uint32_t>{3});
  EXPECT_EQ(frame.exclusions, std::nullopt);
}

TEST_F(Recording, WhatEndsWithinAFrameIsReadWithoutIt) {
  const std::string good = Recorded().header() + Recorded().frame();
  Recorded empty;
  const std::string more = empty.frame();
  for (std::size_t size = 1; size < more.size(); ++size) {
    save("x", good + more.substr(0, size));
    const RecordingReader reader(path("x"));
    EXPECT_THAT(reader.note_of_cut(), testing::StartsWith("The recording ends within frame "));
    EXPECT_EQ(reader.frames(), 1U);
  }
  for (std::size_t size = 8; size < good.size(); ++size) {
    EXPECT_THAT(refusal_of("x", good.substr(0, size)),
                testing::HasSubstr(size < 32 ? "ends within its header" : "has no complete frame"));
  }
}

TEST_F(Recording, WhatIsWrongWithARecordingIsReported) {
  const std::string good = recorded([](auto&) {});
  const std::vector<std::pair<std::string, std::string>> bad_files = {
      {recorded([](auto& file) { file.version = 2; }), "its version is 2"},
      {recorded([](auto& file) { file.precision = 16; }), "its precision is 16"},
      {recorded([](auto& file) { file.distance = -1; }), "header is malformed"},
      {recorded([](auto& file) { file.distance = std::numeric_limits<double>::quiet_NaN(); }),
       "header is malformed"},
      {recorded([](auto& file) { file.zero = 1; }), "header is malformed"},
      {good + "x", "no frame begins at byte"},
      {recorded([](auto& file) { file.count = 0xffffffff; }), "too short for 4294967295 boxes"},
      {recorded([](auto& file) { file.precision = 64; }), "lists are longer than the frame"},
      {recorded([](auto& file) { file.filter[0] = 0xffffffff; }), "lists are longer than the frame"},
      {recorded([](auto& file) { file.reaches = 0xffffffff; }), "lists are longer than the frame"},
      {recorded([](auto& file) { file.gone[0] = 0xffffffff; }), "lists are longer than the frame"},
      {recorded([](auto& file) { file.exclusions[1] = 0xffffffff; }), "lists are longer than the frame"},
      {recorded([](auto& file) { file.exclusions[0] = 2; }), "where exclusions begin"},
      {Recorded().header() + Recorded().frame("more"), "bytes after its lists"},
      {recorded([](auto& file) {
         file.ids = {5, 5};
       }),
       "its ids do not ascend"},
      {recorded([](auto& file) {
         file.ids = {5, 3};
       }),
       "its ids do not ascend"},
      {recorded([](auto& file) {
         file.ids = {3, 0xffffffff};
       }),
       "the id 4294967295 is too high"},
      {recorded([](auto& file) { file.filter[1] = 4; }), "the id 4, which no object has"},
      {recorded([](auto& file) { file.reach_id = 4; }), "the id 4, which no object has"},
      {recorded([](auto& file) { file.numbers[7] = nan; }), "the box of the id 5 has a NaN bound"},
      {recorded([](auto& file) {
         file.gone = {1, 3};
       }),
       "that was not in the frame before"},
      {good + recorded([](auto& file) {
                file.ids = {5, 6};
                file.reach_id = 6;
              }).substr(32),
       "frame 1 (the first is 0): an object of the frame before is missing"},
  };
  for (const auto& [bytes, message] : bad_files) {
    const std::string error = refusal_of("x", bytes);
    EXPECT_THAT(error, testing::StartsWith("cannot use '" + path("x").string() + "': "));
    EXPECT_THAT(error, testing::HasSubstr(message));
  }
  // Whatever a byte becomes, the file is read or refused.
  for (std::size_t k = 0; k < good.size(); ++k) {
    for (const char value : {'\0', '\x7f', '\xff'}) {
      std::string bytes = good;
      bytes[k] = value;
      save("x.npy", bytes);
      try {
        (void)read("x.npy");
      } catch (const Error& error) {
        EXPECT_THAT(error.what(), testing::HasSubstr("x.npy"));
      }
    }
  }
}

TEST_F(Recording, WhatIsNoFileIsRefused) {
  fs::create_directory(path("folder.npy"));
  fs::create_symlink("/dev/zero", path("zero.aabbs"));
  EXPECT_THAT(error_of([&] { (void)read("missing.npy"); }), testing::HasSubstr("cannot read"));
  EXPECT_THAT(error_of([&] { (void)read("folder.npy"); }), testing::HasSubstr("is a directory"));
  EXPECT_THAT(error_of([&] { (void)read("zero.aabbs"); }), testing::HasSubstr("not a regular file"));
}

TEST_F(Recording, AFileThatIsCutMeanwhileIsRefused) {
  const Blocks blocks(4, std::vector<Aabb>(10'000));  // more than a stream buffers
  save("x.aabbs", aabbs(blocks));
  RecordingReader reader(path("x.aabbs"));
  fs::resize_file(path("x.aabbs"), 1'000'000);
  EXPECT_THAT(error_of([&] { (void)rest_of(reader); }), testing::HasSubstr("has it changed"));
}

}  // namespace
}  // namespace broadcl::cli
