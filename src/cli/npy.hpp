#pragma once

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>
#include <filesystem>
#include <iosfwd>
#include <span>
#include <string>
#include <vector>

/// Arrays in the format of NumPy (.npy): "NEP 1, A Simple File Format for NumPy Arrays".
namespace broadcl::cli {

/// Reads boxes from an array of shape (n, 6), a row a box: min x, y, z, max x, y, z. Takes float32 and
/// float64, which rounds outward, of either byte order, by rows or by columns.
/// @throws Error that names the file and what is wrong with it; a NaN is an error that names its row.
[[nodiscard]] std::vector<Aabb> read_boxes(const std::filesystem::path& file);

/// The same from a stream; errors do not name a file.
[[nodiscard]] std::vector<Aabb> read_boxes(std::istream& stream);

/// The bytes of an array of shape (m, 2), little-endian uint32, a row a pair.
[[nodiscard]] std::string to_npy(std::span<const Pair> pairs);

}  // namespace broadcl::cli
