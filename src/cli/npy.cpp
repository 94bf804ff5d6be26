#include "cli/npy.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <broadcl/box_view.hpp>
#include <broadcl/error.hpp>
#include <charconv>
#include <cmath>
#include <istream>
#include <limits>
#include <regex>
#include <string>
#include <system_error>
#include <type_traits>
#include <variant>

#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr std::string_view magic = "\x93NUMPY";
constexpr std::size_t longest_header = 4096;  // NumPy writes 118 bytes for two dimensions

[[noreturn]] void fail(const std::string& header) {
  throw Error("its header is malformed: " + one_line(header.substr(0, 100)) +
              "; save the array again with numpy.save");
}

BoundType bound_type(const std::string& dtype) {
  if (dtype.starts_with('[')) throw Error("its dtype is a record; float32 or float64 is needed");
  const std::string name = dtype.substr(1, dtype.size() - 2);
  if (name != "<f4" && name != ">f4" && name != "<f8" && name != ">f8") {
    throw Error("its dtype is '" + one_line(name) + "'; float32 or float64 is needed");
  }
  return {.is_double = name.back() == '8', .big_endian = name.front() == '>'};
}

/// The dictionary of a header, a Python literal, in the order in which NumPy writes it:
/// {'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), }
NpyHeader parse(const std::string& text) {
  static const std::regex dictionary(
      R"(\s*\{\s*'descr'\s*:\s*('[^']*'|\[[^\]]*\])\s*,\s*'fortran_order'\s*:\s*(True|False)\s*,)"
      R"(\s*'shape'\s*:\s*\(\s*((?:\d+\s*,\s*)*)(\d*)\s*\)\s*,?\s*\}\s*)");
  std::smatch found;
  if (!std::regex_match(text, found, dictionary)) fail(text);
  const std::string sizes = found.str(3) + found.str(4);
  if (found.str(3).empty() && !sizes.empty()) fail(text);  // (3) is not a tuple
  NpyHeader header{.bounds = bound_type(found.str(1)), .fortran_order = found.str(2) == "True", .shape = {}};
  static const std::regex number("\\d+");
  for (std::sregex_iterator size(sizes.begin(), sizes.end(), number), end; size != end; ++size) {
    const std::string digits = size->str();
    std::uint64_t& value = header.shape.emplace_back();
    if (std::from_chars(digits.data(), digits.data() + digits.size(), value).ec != std::errc()) {
      throw Error("its shape is too large for any memory");
    }
  }
  return header;
}

/// Reads up to `size` bytes; fewer if the stream ends early.
std::string read_bytes(std::istream& stream, std::size_t size) {
  constexpr std::size_t chunk = 1'048'576;  // memory grows with the data, whatever the header claims
  std::string bytes;
  while (bytes.size() < size) {
    const std::size_t old_size = bytes.size();
    const std::size_t wanted = std::min(chunk, size - old_size);
    bytes.resize(old_size + wanted);
    stream.read(bytes.data() + old_size, static_cast<std::streamsize>(wanted));
    const auto got = static_cast<std::size_t>(stream.gcount());
    if (got < wanted) {
      bytes.resize(old_size + got);
      break;
    }
  }
  return bytes;
}

/// A number in the byte order of the file.
template <class Number>
Number load(const char* from, bool big_endian) {
  using Bits = std::conditional_t<sizeof(Number) == 8, std::uint64_t, std::uint32_t>;
  Bits bits = 0;
  for (std::size_t i = 0; i < sizeof(Number); ++i) {
    const auto byte = static_cast<unsigned char>(from[big_endian ? sizeof(Number) - 1 - i : i]);
    bits |= Bits{byte} << (8 * i);
  }
  return std::bit_cast<Number>(bits);
}

template <class Number>
std::array<Number, 3> load_corner(const char* from, std::size_t stride, bool big_endian) {
  return {load<Number>(from, big_endian), load<Number>(from + stride, big_endian),
          load<Number>(from + 2 * stride, big_endian)};
}

std::string to_text(const std::vector<std::uint64_t>& shape) {
  std::string text;
  for (const std::uint64_t size : shape) text += (text.empty() ? "" : ", ") + std::to_string(size);
  return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

/// @param row_stride, bound_stride Bytes in the file.
template <class Number>
std::vector<Number> load_rows(const std::string& data, std::size_t rows, std::size_t columns, bool big_endian,
                              std::size_t row_stride, std::size_t bound_stride) {
  std::vector<Number> numbers;
  numbers.reserve(rows * columns);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      numbers.push_back(load<Number>(data.data() + row * row_stride + column * bound_stride, big_endian));
      if (std::isnan(numbers.back())) {
        throw Error("row " + std::to_string(row) +
                    " (the first is 0) holds a NaN; remove it or give it bounds");
      }
    }
  }
  return numbers;
}

void append_little_endian(std::string& bytes, std::uint32_t value, unsigned size) {
  for (unsigned i = 0; i < size; ++i) bytes += static_cast<char>((value >> (8 * i)) & 0xff);
}

}  // namespace

std::string NpyHeader::shape_text() const {
  return to_text(shape);
}

NpyHeader read_npy_header(std::istream& stream) {
  if (const std::string start = read_bytes(stream, magic.size()); start != magic) {
    throw Error(start.starts_with("PK") ? "it is an archive (.npz) of .npy files; save one array as .npy"
                                        : "it is not a NumPy array: the magic bytes of .npy are missing");
  }
  const std::string version = read_bytes(stream, 2);
  if (version.size() == 2 && (version[0] < 1 || version[0] > 3 || version[1] != 0)) {
    throw Error("its format version is not 1.0, 2.0 or 3.0");
  }
  const std::size_t length_size = version.starts_with('\1') ? 2 : 4;
  std::string length_bytes = read_bytes(stream, length_size);
  if (version.size() < 2 || length_bytes.size() < length_size) throw Error("it ends within its header");
  length_bytes.resize(4);
  const auto length = load<std::uint32_t>(length_bytes.data(), false);
  if (length >= longest_header)
    throw Error("its header is malformed: it claims " + std::to_string(length) + " bytes");
  const std::string text = read_bytes(stream, length);
  if (text.size() < length) throw Error("it ends within its header");
  return parse(text);
}

std::string npy_header(std::string_view dtype, const std::vector<std::uint64_t>& shape) {
  constexpr std::size_t alignment = 64;
  std::string dictionary =
      "{'descr': '" + std::string(dtype) + "', 'fortran_order': False, 'shape': " + to_text(shape) + ", }";
  const std::size_t prefix = magic.size() + 4;
  dictionary.append(alignment - 1 - (prefix + dictionary.size()) % alignment, ' ');
  dictionary += '\n';
  std::string bytes(magic);
  bytes += std::string_view("\1\0", 2);
  append_little_endian(bytes, static_cast<std::uint32_t>(dictionary.size()), 2);
  return bytes + dictionary;
}

Aabb load_box(BoundType type, const char* lower, const char* upper, std::size_t stride) {
  if (!type.is_double) {
    return {load_corner<float>(lower, stride, type.big_endian),
            load_corner<float>(upper, stride, type.big_endian)};
  }
  const std::array corners{load_corner<double>(lower, stride, type.big_endian),
                           load_corner<double>(upper, stride, type.big_endian)};
  return BoxView::corners(corners[0].data(), corners[1].data(), 1)[0];
}

BoxView FileBoxes::view() const& {
  return std::visit(
      [&](const auto& all) {
        return columns == 6 ? BoxView::interleaved(all.data(), all.size() / columns)
                            : BoxView::rectangles(all.data(), all.size() / columns);
      },
      numbers);
}

std::vector<Aabb> FileBoxes::as_float32() const {
  std::vector<Aabb> boxes(view().size());
  view().copy_to(boxes);
  return boxes;
}

FileBoxes read_boxes(std::istream& stream) {
  const NpyHeader header = read_npy_header(stream);
  if (header.shape.size() != 2 || (header.shape[1] != 6 && header.shape[1] != 4)) {
    throw Error("its shape is " + header.shape_text() + "; (n, 6) or (n, 4) is needed: " + box_columns_text);
  }
  if (header.shape[0] > std::numeric_limits<std::uint32_t>::max()) {
    throw Error("its shape " + header.shape_text() + " is too large: boxes are numbered in 32 bits");
  }
  const auto rows = static_cast<std::size_t>(header.shape[0]);
  const auto columns = static_cast<std::size_t>(header.shape[1]);
  const std::size_t size = rows * columns * header.bounds.size();
  const std::string data = read_bytes(stream, size);
  if (data.size() < size) {
    throw Error("it is truncated: its shape " + header.shape_text() + " needs " + std::to_string(size) +
                " bytes of data, but it has " + std::to_string(data.size()));
  }
  if (stream.peek() != std::istream::traits_type::eof()) {
    throw Error("it has more than the " + std::to_string(size) + " bytes of data that its shape " +
                header.shape_text() + " needs");
  }

  const std::size_t number = header.bounds.size();
  const std::size_t row_stride = header.fortran_order ? number : columns * number;
  const std::size_t bound_stride = header.fortran_order ? rows * number : number;
  const bool big_endian = header.bounds.big_endian;
  if (header.bounds.is_double) {
    return {load_rows<double>(data, rows, columns, big_endian, row_stride, bound_stride), columns};
  }
  return {load_rows<float>(data, rows, columns, big_endian, row_stride, bound_stride), columns};
}

std::string to_npy(std::span<const Pair> pairs) {
  std::string bytes = npy_header("<u4", {pairs.size(), 2});
  bytes.reserve(bytes.size() + pairs.size() * 8);
  for (const Pair& pair : pairs) {
    append_little_endian(bytes, pair.a, 4);
    append_little_endian(bytes, pair.b, 4);
  }
  return bytes;
}

}  // namespace broadcl::cli
