#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace broadcl::cli {

/// The text with each control character, line breaks among them, replaced by a space.
[[nodiscard]] std::string one_line(std::string text);

/// A path as messages show it: quoted, on one line.
[[nodiscard]] std::string quoted(const std::filesystem::path& path);

/// A text as a field of a CSV file, quoted where it has to be (RFC 4180).
[[nodiscard]] std::string csv_field(const std::string& text);

/// "3.1416" for 4 decimals.
[[nodiscard]] std::string fixed(double value, int decimals);

/// "15.6 GiB", for a number of bytes.
[[nodiscard]] std::string size_text(std::uint64_t bytes);

/// Elements with commas between them, as options take lists.
[[nodiscard]] std::string list_of(const std::vector<std::string>& names);
[[nodiscard]] std::string list_of(const std::vector<std::uint32_t>& numbers);

/// "16,000".
[[nodiscard]] std::string grouped(std::uint64_t value);

/// "95 s", "12 min" or "3 h 5 min", for at least 0 seconds.
[[nodiscard]] std::string duration_text(double seconds);

/// Brings a text to a width with spaces after it.
[[nodiscard]] std::string left(std::string text, std::size_t width);

/// Brings a text to a width with spaces before it.
[[nodiscard]] std::string right(const std::string& text, std::size_t width);

}  // namespace broadcl::cli
