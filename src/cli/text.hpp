#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace broadcl::cli {

/// The text with each control character, line breaks among them, replaced by a space.
[[nodiscard]] std::string one_line(std::string text);

/// A path as messages show it: quoted, on one line.
[[nodiscard]] std::string quoted(const std::filesystem::path& path);

/// "3.1416" for 4 decimals.
[[nodiscard]] std::string fixed(double value, int decimals);

/// "15.6 GiB", for a number of bytes.
[[nodiscard]] std::string size_text(std::uint64_t bytes);

/// Brings a text to a width with spaces after it.
[[nodiscard]] std::string left(std::string text, std::size_t width);

/// Brings a text to a width with spaces before it.
[[nodiscard]] std::string right(const std::string& text, std::size_t width);

}  // namespace broadcl::cli
