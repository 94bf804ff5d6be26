#include "cli/npy.hpp"

#include <gtest/gtest.h>

#include <broadcl/error.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

#include "npy_bytes.hpp"
#include "test_name.hpp"

namespace broadcl::cli {
namespace {

using test::bytes_of;
using test::little_endian;
using test::npy;
using test::swapped_bytes_of;

const std::string float_rows = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }";

std::vector<Aabb> read(const std::string& file) {
  std::istringstream stream(file);
  return read_boxes(stream).as_float32();
}

/// The text of the error that a file causes, empty if it causes none.
std::string error_of(const std::string& file) {
  try {
    (void)read(file);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

const std::vector<float> two_rows = {0, 1, 2, 3, 4, 5, -6, -5, -4, -3, -2, -1};
const std::vector<Aabb> two_boxes = {{{0, 1, 2}, {3, 4, 5}}, {{-6, -5, -4}, {-3, -2, -1}}};

TEST(NpyRead, Float32) {
  EXPECT_EQ(read(npy(float_rows, bytes_of(two_rows))), two_boxes);
}

TEST(NpyRead, EveryFormatVersion) {
  for (const unsigned version : {1U, 2U, 3U}) {
    EXPECT_EQ(read(npy(float_rows, bytes_of(two_rows), version)), two_boxes) << version;
  }
}

TEST(NpyRead, BigEndian) {
  const std::string header = "{'descr': '>f4', 'fortran_order': False, 'shape': (2, 6), }";
  EXPECT_EQ(read(npy(header, swapped_bytes_of(two_rows))), two_boxes);
  const std::string header64 = "{'descr': '>f8', 'fortran_order': False, 'shape': (2, 6), }";
  const std::vector<double> rows(two_rows.begin(), two_rows.end());
  EXPECT_EQ(read(npy(header64, swapped_bytes_of(rows))), two_boxes);
}

TEST(NpyRead, FortranOrder) {
  const std::vector<float> by_columns = {0, -6, 1, -5, 2, -4, 3, -3, 4, -2, 5, -1};
  const std::string header = "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 6), }";
  EXPECT_EQ(read(npy(header, bytes_of(by_columns))), two_boxes);
}

TEST(NpyRead, Float64IsKept) {
  const std::vector<double> numbers{0.1, -0.1, 0.5, 0.1, 0.2, 1e300};
  std::istringstream stream(
      npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 6), }", bytes_of(numbers)));
  EXPECT_EQ(std::get<std::vector<double>>(read_boxes(stream).numbers), numbers);
}

TEST(NpyRead, Float64AsFloat32RoundsOutward) {
  const std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 6), }";
  const auto boxes = read(npy(header, bytes_of(std::vector<double>{0.1, -0.1, 0.5, 0.1, 0.2, 1e300})));
  ASSERT_EQ(boxes.size(), 1U);
  for (const double lower : {0.1, -0.1, 0.5}) {
    const std::size_t axis = lower == 0.1 ? 0 : lower == -0.1 ? 1 : 2;
    EXPECT_LE(static_cast<double>(boxes[0].lower.at(axis)), lower);
    EXPECT_GT(static_cast<double>(std::nextafter(boxes[0].lower.at(axis), 2.0F)), lower);
  }
  EXPECT_GE(static_cast<double>(boxes[0].upper[0]), 0.1);
  EXPECT_LT(static_cast<double>(std::nextafter(boxes[0].upper[0], 0.0F)), 0.1);
  EXPECT_EQ(boxes[0].lower[2], 0.5F);
  EXPECT_EQ(boxes[0].upper[2], std::numeric_limits<float>::infinity());
}

TEST(NpyRead, Float64BoxThatIsBarelyEmptyStaysEmpty) {
  const std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 6), }";
  const auto boxes = read(npy(header, bytes_of(std::vector<double>{1.0000000001, 0, 0, 1, 1, 1})));
  ASSERT_EQ(boxes.size(), 1U);
  EXPECT_TRUE(is_empty(boxes[0]));
}

TEST(NpyRead, NoBoxes) {
  EXPECT_TRUE(read(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (0, 6), }", "")).empty());
}

TEST(NpyRead, AnySpacing) {
  const std::string header = "{ 'descr': '<f4','fortran_order' :False , 'shape':( 2,6 ,)}   \n";
  EXPECT_EQ(read(npy(header, bytes_of(two_rows))), two_boxes);
}

TEST(NpyRead, InfiniteAndInvertedBoxesAreLegal) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  const std::vector<float> rows = {-infinity, 0, 0, infinity, 1, 1, 1, 1, 1, 0, 0, 0};
  const std::vector<Aabb> expected = {{{-infinity, 0, 0}, {infinity, 1, 1}}, {{1, 1, 1}, {0, 0, 0}}};
  EXPECT_EQ(read(npy(float_rows, bytes_of(rows))), expected);
}

TEST(NpyRead, ManyRows) {
  constexpr std::size_t count = 100'000;  // more than is read at once
  std::vector<float> values(6 * count);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i);
  const std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (100000, 6), }";
  const std::vector<Aabb> boxes = read(npy(header, bytes_of(values)));
  ASSERT_EQ(boxes.size(), count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto first = static_cast<float>(6 * i);
    ASSERT_EQ(boxes[i], (Aabb{{first, first + 1, first + 2}, {first + 3, first + 4, first + 5}})) << i;
  }
}

struct BadFile {
  std::string name;
  std::string file;
  std::string message;  ///< Part of the error.

  friend std::ostream& operator<<(std::ostream& stream, const BadFile& bad) { return stream << bad.name; }
};

class NpyBadFile : public testing::TestWithParam<BadFile> {};

TEST_P(NpyBadFile, GetsItsMessage) {
  const std::string error = error_of(GetParam().file);
  EXPECT_NE(error.find(GetParam().message), std::string::npos) << "the error was: " << error;
  EXPECT_EQ(error.find('\n'), std::string::npos);
}

std::string with_header(const std::string& header) {
  return npy(header, bytes_of(two_rows));
}

std::string with_dtype(const std::string& dtype) {
  return with_header("{'descr': " + dtype + ", 'fortran_order': False, 'shape': (2, 6), }");
}

std::string with_shape(const std::string& shape) {
  return with_header("{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + ", }");
}

std::string with_nan(std::size_t position) {
  std::vector<float> rows = two_rows;
  rows.at(position) = std::numeric_limits<float>::quiet_NaN();
  return npy(float_rows, bytes_of(rows));
}

std::vector<BadFile> bad_files() {
  const std::string good = npy(float_rows, bytes_of(two_rows));
  return {
      {"Empty", "", "magic bytes"},
      {"Text", "0 0 0 1 1 1\n", "magic bytes"},
      {"Zip", "PK\3\4 and so on", "it is an archive (.npz) of .npy files; save one array"},
      {"Version4", npy(float_rows, bytes_of(two_rows), 4), "format version"},
      {"Version1Minor1", "\x93NUMPY\1\1" + good.substr(8), "format version"},
      {"CutAfterMagic", good.substr(0, 6), "ends within its header"},
      {"CutInLength", good.substr(0, 9), "ends within its header"},
      {"CutInHeader", good.substr(0, 40), "ends within its header"},
      {"CutBeforeData", good.substr(0, 10 + float_rows.size()), "needs 48 bytes of data, but it has 0"},
      {"CutInData", good.substr(0, good.size() - 1), "needs 48 bytes of data, but it has 47"},
      {"TrailingByte", good + "x", "more than the 48 bytes"},
      {"HugeHeader", "\x93NUMPY" + little_endian(2, 2) + little_endian(0xffffffff, 4) + "{",
       "4294967295 bytes"},
      {"NoDictionary", with_header("[1, 2]"), "header is malformed: [1, 2]; save"},
      {"EmptyHeader", with_header(""), "header is malformed"},
      {"OpenDictionary", with_header("{'descr': '<f4'"), "header is malformed"},
      {"OpenString", with_header("{'descr: "), "header is malformed"},
      {"NoShape", with_header("{'descr': '<f4', 'fortran_order': False, }"), "header is malformed"},
      {"UnknownKey", with_header("{'descr': '<f4', 'colour': 'red'}"), "'colour'"},
      {"LineBreakInKey", with_header("{'a\nb': '<f4'}"), "'a b'"},
      {"SomethingFollows", with_header(float_rows + " 1"), "header is malformed"},
      {"OrderIsANumber", with_header("{'descr': '<f4', 'fortran_order': 0, 'shape': (2, 6)}"),
       "header is malformed"},
      {"LongHeader", with_header(std::string(4096, '(')), "it claims 4096 bytes"},
      {"Integers", with_dtype("'<i4'"), "dtype is '<i4'"},
      {"Half", with_dtype("'<f2'"), "dtype is '<f2'"},
      {"Object", with_dtype("'|O'"), "dtype is '|O'"},
      {"EmptyDtype", with_dtype("''"), "dtype is ''"},
      {"Records", with_dtype("[('x', '<f4')]"), "dtype is a record"},
      {"DtypeIsANumber", with_dtype("4"), "header is malformed"},
      {"OneDimension", with_shape("(12,)"), "shape is (12,)"},
      {"NoDimension", with_shape("()"), "shape is ()"},
      {"ThreeDimensions", with_shape("(2, 2, 3)"), "shape is (2, 2, 3)"},
      {"FiveColumns", with_shape("(2, 5)"), "shape is (2, 5)"},
      {"RowsAndColumnsSwapped", with_shape("(6, 2)"), "shape is (6, 2)"},
      {"NegativeShape", with_shape("(-2, 6)"), "header is malformed"},
      {"FractionalShape", with_shape("(2.5, 6)"), "header is malformed"},
      {"ShapeWithoutComma", with_shape("(2 6)"), "header is malformed"},
      {"ShapeIsANumber", with_shape("(12)"), "header is malformed"},
      {"ShapeIsOpen", with_header("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6"),
       "header is malformed"},
      {"ShapeIsNoTuple", with_shape("12"), "header is malformed"},
      {"MoreRowsThanThereAre", with_shape("(4294967295, 6)"), "needs 103079215080 bytes"},
      {"MoreRowsThanIds", with_shape("(4294967296, 6)"), "too large"},
      {"SizeOverflows", with_shape("(3074457345618258604, 6)"), "too large"},
      {"RowsOverflow", with_shape("(99999999999999999999, 6)"), "too large"},
      {"NanInFirstRow", with_nan(0), "row 0 "},
      {"NanInLastColumn", with_nan(11), "row 1 "},
  };
}

INSTANTIATE_TEST_SUITE_P(All, NpyBadFile, testing::ValuesIn(bad_files()), test::named_by_parameter);

TEST(NpyWrite, HeaderIsAsNumpyWritesIt) {
  const std::string file = to_npy(std::vector<Pair>{{0, 1}, {0x01020304, 0x05060708}});
  EXPECT_EQ(file.substr(0, 8), std::string("\x93NUMPY\1\0", 8));
  const std::size_t length = static_cast<unsigned char>(file[8]) + 256U * static_cast<unsigned char>(file[9]);
  EXPECT_EQ((10 + length) % 64, 0U);
  const std::string header = file.substr(10, length);
  EXPECT_TRUE(header.starts_with("{'descr': '<u4', 'fortran_order': False, 'shape': (2, 2), } ")) << header;
  EXPECT_EQ(header.back(), '\n');
  EXPECT_EQ(file.substr(10 + length), std::string("\0\0\0\0\1\0\0\0\4\3\2\1\10\7\6\5", 16));
}

TEST(NpyWrite, NoPairs) {
  const std::string file = to_npy({});
  EXPECT_EQ(file.size() % 64, 0U);
  EXPECT_NE(file.find("(0, 2)"), std::string::npos);
}

}  // namespace
}  // namespace broadcl::cli
