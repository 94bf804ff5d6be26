#pragma once

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Arrays in the format of NumPy (.npy): "NEP 1, A Simple File Format for NumPy Arrays".
namespace broadcl::cli {

/// How the bounds of boxes lie in a file: float32 or float64, in either byte order.
struct BoundType {
  bool is_double = false;
  bool big_endian = false;

  [[nodiscard]] std::size_t size() const noexcept { return is_double ? 8 : 4; }
};

/// What an array of bounds says of itself.
struct NpyHeader {
  BoundType bounds;
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;

  /// "(2, 6)", as Python writes it.
  [[nodiscard]] std::string shape_text() const;
};

/// Reads the header; the data come next in the stream.
/// @throws Error for a header that is malformed and for numbers that are neither float32 nor float64.
[[nodiscard]] NpyHeader read_npy_header(std::istream& stream);

/// The bytes before the data of an array by rows.
/// @param dtype As NumPy writes it: "<f4".
[[nodiscard]] std::string npy_header(std::string_view dtype, const std::vector<std::uint64_t>& shape);

/// A box from where its corners lie, each three numbers `stride` bytes apart. Float64 rounds outward, except
/// that an empty box stays empty.
[[nodiscard]] Aabb load_box(BoundType type, const char* lower, const char* upper, std::size_t stride);

/// Reads boxes from an array of shape (n, 6), a row a box: min x, y, z, max x, y, z. Takes float32 and
/// float64, which rounds outward, of either byte order, by rows or by columns.
/// @throws Error that names the file and what is wrong with it; a NaN is an error that names its row.
[[nodiscard]] std::vector<Aabb> read_boxes(const std::filesystem::path& file);

/// The same from a stream; errors do not name a file.
[[nodiscard]] std::vector<Aabb> read_boxes(std::istream& stream);

/// The bytes of an array of shape (m, 2), little-endian uint32, a row a pair.
[[nodiscard]] std::string to_npy(std::span<const Pair> pairs);

}  // namespace broadcl::cli
