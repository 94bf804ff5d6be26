#include "cli/npy.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <broadcl/error.hpp>
#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <istream>
#include <limits>
#include <optional>
#include <string_view>
#include <system_error>
#include <type_traits>

#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr std::string_view magic = "\x93NUMPY";
constexpr std::size_t longest_header = 65535;
constexpr std::size_t columns = 6;

struct Header {
  std::string dtype;
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;
};

std::string to_text(const std::vector<std::uint64_t>& shape) {
  std::string text;
  for (const std::uint64_t size : shape) text += (text.empty() ? "" : ", ") + std::to_string(size);
  return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

/// Reads the dictionary of a header, which is a Python literal:
/// {'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), }
class HeaderParser {
 public:
  explicit HeaderParser(std::string_view text) : rest_(text) {}

  Header parse() {
    std::optional<std::string> dtype;
    std::optional<bool> fortran_order;
    std::optional<std::vector<std::uint64_t>> shape;
    expect('{');
    while (!accept('}')) {
      const std::string key = string();
      expect(':');
      if (key == "descr" && !dtype) {
        dtype = dtype_string();
      } else if (key == "fortran_order" && !fortran_order) {
        fortran_order = boolean();
      } else if (key == "shape" && !shape) {
        shape = tuple();
      } else {
        fail("the key '" + key + "' is unknown or there twice");
      }
      if (!accept(',')) {
        expect('}');
        break;
      }
    }
    skip_spaces();
    if (!rest_.empty()) fail("something follows the dictionary");
    if (!dtype || !fortran_order || !shape) fail("'descr', 'fortran_order' or 'shape' is missing");
    return {*dtype, *fortran_order, *shape};
  }

 private:
  [[noreturn]] static void fail(const std::string& what) {
    throw Error("its header is malformed: " + one_line(what) + "; save the array again with numpy.save");
  }

  void skip_spaces() { rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t\n"), rest_.size())); }

  bool accept(std::string_view token) {
    skip_spaces();
    if (!rest_.starts_with(token)) return false;
    rest_.remove_prefix(token.size());
    return true;
  }
  bool accept(char token) { return accept(std::string_view(&token, 1)); }

  void expect(char token) {
    if (!accept(token)) fail(std::string("'") + token + "' is missing");
  }

  std::string string() {
    skip_spaces();
    const char quote = rest_.empty() ? '\0' : rest_.front();
    if (quote != '\'' && quote != '"') fail("a string is missing");
    const std::size_t end = rest_.find(quote, 1);
    if (end == std::string_view::npos) fail("a string does not end");
    std::string text(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return text;
  }

  std::string dtype_string() {
    if (accept('[')) throw Error("its dtype is that of records; float32 or float64 is needed");
    return string();
  }

  bool boolean() {
    if (accept("True")) return true;
    if (!accept("False")) fail("'fortran_order' is neither True nor False");
    return false;
  }

  std::uint64_t integer() {
    skip_spaces();
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (error == std::errc::result_out_of_range) throw Error("its shape is too large for any memory");
    if (error != std::errc()) fail("'shape' is not a tuple of sizes");
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return value;
  }

  std::vector<std::uint64_t> tuple() {
    std::vector<std::uint64_t> sizes;
    bool comma = true;
    expect('(');
    while (!accept(')')) {
      if (!comma) fail("'shape' is not a tuple of sizes");
      sizes.push_back(integer());
      comma = accept(',');
    }
    if (sizes.size() == 1 && !comma) fail("'shape' is not a tuple of sizes");
    return sizes;
  }

  std::string_view rest_;
};

/// Reads up to `size` bytes; fewer where the stream ends before.
std::string read_bytes(std::istream& stream, std::size_t size) {
  constexpr std::size_t chunk = 1'048'576;  // what a header claims is not allocated before it is there
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

Header read_header(std::istream& stream) {
  if (read_bytes(stream, magic.size()) != magic) {
    throw Error("it is not a NumPy array: the magic bytes of .npy are missing");
  }
  const std::string version = read_bytes(stream, 2);
  if (version.size() == 2 && (version[0] < 1 || version[0] > 3 || version[1] != 0)) {
    throw Error("its format version is not 1.0, 2.0 or 3.0");
  }
  const std::size_t length_size = version.starts_with('\1') ? 2 : 4;
  std::string length_bytes = read_bytes(stream, length_size);
  if (version.size() < 2 || length_bytes.size() < length_size) throw Error("it is cut within its header");
  length_bytes.resize(4);
  const auto length = load<std::uint32_t>(length_bytes.data(), false);
  if (length > longest_header)
    throw Error("its header is malformed: it claims " + std::to_string(length) + " bytes");
  const std::string text = read_bytes(stream, length);
  if (text.size() < length) throw Error("it is cut within its header");
  return HeaderParser(text).parse();
}

Aabb to_aabb(const std::array<float, columns>& row) {
  return {{row[0], row[1], row[2]}, {row[3], row[4], row[5]}};
}

Aabb to_aabb(const std::array<double, columns>& row) {
  return round_outward({row[0], row[1], row[2]}, {row[3], row[4], row[5]});
}

template <class Number>
std::vector<Aabb> read_rows(std::istream& stream, const Header& header) {
  const auto rows = static_cast<std::size_t>(header.shape[0]);
  const std::size_t size = rows * columns * sizeof(Number);
  const std::string data = read_bytes(stream, size);
  if (data.size() < size) {
    throw Error("it is cut: its shape " + to_text(header.shape) + " needs " + std::to_string(size) +
                " bytes of data, it has " + std::to_string(data.size()));
  }
  if (stream.peek() != std::istream::traits_type::eof()) {
    throw Error("bytes follow the " + std::to_string(size) + " that its shape " + to_text(header.shape) +
                " needs");
  }

  const bool big_endian = header.dtype.front() == '>';
  std::vector<Aabb> boxes;
  boxes.reserve(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    std::array<Number, columns> values;
    for (std::size_t column = 0; column < columns; ++column) {
      const std::size_t position = header.fortran_order ? column * rows + row : row * columns + column;
      values[column] = load<Number>(data.data() + position * sizeof(Number), big_endian);
    }
    boxes.push_back(to_aabb(values));
    if (has_nan(boxes.back())) {
      throw Error("row " + std::to_string(row) +
                  " (the first is 0) holds a NaN; remove it or give it bounds");
    }
  }
  return boxes;
}

}  // namespace

std::vector<Aabb> read_boxes(std::istream& stream) {
  const Header header = read_header(stream);
  const bool is_float = header.dtype == "<f4" || header.dtype == ">f4";
  if (!is_float && header.dtype != "<f8" && header.dtype != ">f8") {
    throw Error("its dtype is '" + one_line(header.dtype) + "'; float32 or float64 is needed");
  }
  if (header.shape.size() != 2 || header.shape[1] != columns) {
    throw Error("its shape is " + to_text(header.shape) + "; (n, 6) is needed: min x, y, z, max x, y, z");
  }
  if (header.shape[0] > std::numeric_limits<std::uint32_t>::max()) {
    throw Error("its shape " + to_text(header.shape) + " is too large: boxes are numbered in 32 bits");
  }
  return is_float ? read_rows<float>(stream, header) : read_rows<double>(stream, header);
}

std::vector<Aabb> read_boxes(const std::filesystem::path& file) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(file, ignored);
  if (std::filesystem::is_directory(status)) throw Error(quoted(file) + " is a directory; name a .npy file");
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw Error("cannot read " + quoted(file) + ": " + std::generic_category().message(errno));
  try {
    return read_boxes(stream);
  } catch (const Error& error) {
    throw Error("cannot use " + quoted(file) + ": " + error.what());
  }
}

std::string to_npy(std::span<const Pair> pairs) {
  constexpr std::size_t alignment = 64;
  std::string header =
      "{'descr': '<u4', 'fortran_order': False, 'shape': (" + std::to_string(pairs.size()) + ", 2), }";
  const std::size_t prefix = magic.size() + 4;
  header.append(alignment - 1 - (prefix + header.size()) % alignment, ' ');
  header += '\n';

  std::string bytes(magic);
  const auto append = [&bytes](std::uint32_t value, unsigned size) {
    for (unsigned i = 0; i < size; ++i) bytes += static_cast<char>((value >> (8 * i)) & 0xff);
  };
  bytes.reserve(prefix + header.size() + pairs.size() * 8);
  bytes += std::string_view("\1\0", 2);
  append(static_cast<std::uint32_t>(header.size()), 2);
  bytes += header;
  for (const Pair& pair : pairs) {
    append(pair.a, 4);
    append(pair.b, 4);
  }
  return bytes;
}

}  // namespace broadcl::cli
