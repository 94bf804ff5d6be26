#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace broadcl::cli {

/// The text with each control character, including line breaks, replaced by a space.
[[nodiscard]] std::string one_line(std::string text);

/// A path for messages: quoted, on one line.
[[nodiscard]] std::string quoted(const std::filesystem::path& path);

/// "3.1416" for 4 decimals.
[[nodiscard]] std::string fixed(double value, int decimals);

/// "15.6 GiB", for a number of bytes.
[[nodiscard]] std::string size_text(std::uint64_t bytes);

/// "1 frame", "12 frames", "1 box", "2 boxes".
[[nodiscard]] std::string counted(std::uint64_t count, const std::string& noun);

/// "95 s", "12 min" or "3 h 5 min", for at least 0 seconds.
[[nodiscard]] std::string duration_text(double seconds);

/// Pads a text to a width with spaces after it.
[[nodiscard]] std::string left(std::string text, std::size_t width);

/// Pads a text to a width with spaces before it.
[[nodiscard]] std::string right(const std::string& text, std::size_t width);

}  // namespace broadcl::cli
