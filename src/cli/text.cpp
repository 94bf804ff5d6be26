#include "cli/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iomanip>
#include <sstream>
#include <string_view>

namespace broadcl::cli {

std::string one_line(std::string text) {
  const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
  std::replace_if(text.begin(), text.end(), is_control, ' ');
  return text;
}

std::string quoted(const std::filesystem::path& path) {
  return std::string("'").append(one_line(path.string())).append("'");
}

std::string fixed(double value, int decimals) {
  std::ostringstream stream;
  stream << std::fixed << std::setprecision(decimals) << value;
  return stream.str();
}

std::string size_text(std::uint64_t bytes) {
  constexpr std::array<std::string_view, 5> units = {"B", "KiB", "MiB", "GiB", "TiB"};
  auto value = static_cast<double>(bytes);
  std::size_t unit = 0;
  while (value >= 1024 && unit + 1 < units.size()) {
    value /= 1024;
    ++unit;
  }
  return fixed(value, unit == 0 ? 0 : 1) + " " + std::string(units[unit]);
}

std::string counted(std::uint64_t count, const std::string& noun) {
  const std::string ending = noun.ends_with('x') ? "es" : "s";
  return std::to_string(count) + " " + noun + (count == 1 ? "" : ending);
}

std::string duration_text(double seconds) {
  constexpr std::uint64_t minute = 60;
  constexpr std::uint64_t hour = 60 * minute;
  constexpr double longest = 1e9;
  const auto whole = static_cast<std::uint64_t>(std::llround(std::min(seconds, longest)));
  if (whole < 2 * minute) return std::to_string(whole) + " s";
  if (whole < 2 * hour) return std::to_string(whole / minute) + " min";
  return std::to_string(whole / hour) + " h " + std::to_string(whole % hour / minute) + " min";
}

std::string left(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

std::string right(const std::string& text, std::size_t width) {
  return std::string(width - std::min(width, text.size()), ' ') + text;
}

}  // namespace broadcl::cli
