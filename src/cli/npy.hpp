#pragma once

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/pair.hpp>
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

/// Arrays in the format of NumPy (.npy): "NEP 1, A Simple File Format for NumPy Arrays".
namespace broadcl::cli {

/// The type of the bounds in a file: float32 or float64, in either byte order.
struct BoundType {
  bool is_double = false;
  bool big_endian = false;

  [[nodiscard]] std::size_t size() const noexcept { return is_double ? 8 : 4; }
};

/// The header of an array of bounds.
struct NpyHeader {
  BoundType bounds;
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;

  /// "(2, 6)", as Python writes it.
  [[nodiscard]] std::string shape_text() const;
};

/// Reads the header; the stream then stands at the data.
/// @throws Error if the header is malformed, or if the numbers are neither float32 nor float64.
[[nodiscard]] NpyHeader read_npy_header(std::istream& stream);

/// The bytes that come before the data of an array in C order.
/// @param dtype As NumPy writes it: "<f4".
[[nodiscard]] std::string npy_header(std::string_view dtype, const std::vector<std::uint64_t>& shape);

/// Loads a box, each of whose corners is three numbers `stride` bytes apart. Float64 is rounded outward,
/// except that an empty box stays empty.
[[nodiscard]] Aabb load_box(BoundType type, const char* lower, const char* upper, std::size_t stride);

inline constexpr const char* box_columns_text = "min x, y, z, max x, y, z, or min x, y, max x, y";

/// The numbers of boxes as a file has them: per box, min x, y, z, max x, y, z, or in two dimensions min x, y,
/// max x, y.
struct FileBoxes {
  std::variant<std::vector<float>, std::vector<double>> numbers;
  std::size_t columns = 6;  ///< Or 4.

  /// Valid as long as the numbers.
  [[nodiscard]] BoxView view() const&;
  BoxView view() && = delete;
  [[nodiscard]] std::vector<Aabb> as_float32() const;
};

/// Reads boxes from an array of shape (n, 6) or (n, 4), one row per box. Takes float32 and float64, in either
/// byte order, in C or Fortran order.
/// @throws Error that says what is wrong; for a NaN, also its row.
[[nodiscard]] FileBoxes read_boxes(std::istream& stream);

/// The bytes of an array of shape (m, 2), little-endian uint32, one row per pair.
[[nodiscard]] std::string to_npy(std::span<const Pair> pairs);

}  // namespace broadcl::cli
