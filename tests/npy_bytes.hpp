#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

/// The bytes of numbers and arrays in files.
namespace broadcl::test {

inline std::string little_endian(std::uint64_t value, std::size_t size) {
  std::string bytes;
  for (std::size_t i = 0; i < size; ++i) bytes += static_cast<char>((value >> (8 * i)) & 0xff);
  return bytes;
}

inline std::string bytes_of(float value) {
  return little_endian(std::bit_cast<std::uint32_t>(value), 4);
}

inline std::string bytes_of(double value) {
  return little_endian(std::bit_cast<std::uint64_t>(value), 8);
}

template <class Number>
std::string bytes_of(const std::vector<Number>& values) {
  std::string bytes;
  for (const Number value : values) bytes += bytes_of(value);
  return bytes;
}

template <class Number>
std::string swapped_bytes_of(const std::vector<Number>& values) {
  std::string bytes;
  for (const Number value : values) {
    const std::string number = bytes_of(value);
    bytes.append(number.rbegin(), number.rend());
  }
  return bytes;
}

/// A .npy file of a format version.
inline std::string npy(const std::string& header, const std::string& data, unsigned version = 1) {
  return "\x93NUMPY" + little_endian(version, 2) + little_endian(header.size(), version == 1 ? 2 : 4) +
         header + data;
}

}  // namespace broadcl::test
