#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "cli/simulation.hpp"
#include "cli/statistics.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

constexpr double row_height = 34;
constexpr double top = 74;  // of the first bar
constexpr double left_of_bars = 150;
constexpr double longest = 430;  // bar

/// Of the first broad phases; others have the last one. They are those of the figures of the study.
constexpr std::array colours = {"#a8401c", "#0e8f63", "#ee2a96", "#1f57dd", "#d9a400", "#a77af0", "#6d7280"};

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : one_line(text)) {
    result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : std::string(1, c);
  }
  return result;
}

std::string svg_text(double x, double y, const std::string& text, const std::string& style = "") {
  return "<text x='" + fixed(x, 0) + "' y='" + fixed(y, 0) + "' style='" + style + "'>" + escaped(text) +
         "</text>\n";
}

double milliseconds_of(const SimulationResult& result) {
  return summarize(without_warm_up(result.update)).mean + summarize(without_warm_up(result.broad_phase)).mean;
}

}  // namespace

std::string svg_report(const std::string& heading, std::span<const std::string> broadphases,
                       std::span<const SimulationResult> results) {
  double slowest = 0;
  for (const SimulationResult& result : results) slowest = std::max(slowest, milliseconds_of(result));
  const double first = milliseconds_of(results.front());
  std::string bars;
  for (std::size_t k = 0; k < results.size(); ++k) {
    const double time = milliseconds_of(results[k]);
    const double length = longest * time / slowest;
    const double y = top + row_height * static_cast<double>(k);
    bars += svg_text(left_of_bars - 8, y + 16, broadphases[k], "text-anchor: end");
    bars += "<rect x='" + fixed(left_of_bars, 0) + "' y='" + fixed(y, 0) + "' width='" + fixed(length, 1) +
            "' height='22' fill='" + colours.at(std::min(k, colours.size() - 1)) + "'/>\n";
    bars += svg_text(left_of_bars + length + 8, y + 16,
                     fixed(time, 3) + " ms" + (k > 0 ? ", " + fixed(time / first, 2) + "×" : ""));
  }
  const double height = top + row_height * static_cast<double>(results.size()) + 6;
  const std::string title = "Update and broad phase, mean ms per frame";
  // (Colours of text and background follow those of the reader's system.)
  return "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 740 " + fixed(height, 0) +
         "' font-family='sans-serif' font-size='13'>\n"
         "<style>svg { background: #fff } text { fill: #1d2430 } @media (prefers-color-scheme: dark) "
         "{ svg { background: #14181f } text { fill: #e6e9ef } }</style>\n" +
         svg_text(14, 26, title + (results.size() > 1 ? ", and as a multiple of the first" : ""),
                  "font-size: 15px; font-weight: bold") +
         svg_text(14, 48, heading) + bars + "</svg>\n";
}

}  // namespace broadcl::cli
