#include "cli/study_run_file.hpp"

#include <charconv>
#include <cmath>
#include <concepts>
#include <locale>
#include <numeric>
#include <sstream>
#include <string>
#include <system_error>

namespace broadcl::cli {
namespace {

/// Reads a text that is a number as a whole.
bool read(std::string_view text, std::unsigned_integral auto& value) {
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && rest == end;
}
// (libc++ has no std::from_chars for them.)
bool read(std::string_view text, double& value) {
  std::istringstream stream{std::string(text)};
  stream.imbue(std::locale::classic());
  return (stream >> std::noskipws >> value) && stream.peek() == std::istringstream::traits_type::eof();
}

/// Takes a number and the character after it from the front of a text. False if they are not there.
bool take(std::string_view& text, auto& value, char end) {
  const std::size_t size = text.find(end);
  if (size == std::string_view::npos || !read(text.substr(0, size), value)) return false;
  text.remove_prefix(size + 1);
  return true;
}

/// Whether times are possible: the parts must not exceed the total, except by rounding.
bool are_sound(double update, double broad_phase, double total) {
  constexpr double rounding = 2e-6;
  return update >= 0 && broad_phase >= 0 && std::isfinite(total) && total + rounding >= update + broad_phase;
}

}  // namespace

std::optional<RunFrames> parse_run_file(std::string_view text, std::uint32_t frames) {
  constexpr std::string_view header = "frame,update_ms,broad_phase_ms,total_ms,pairs\n";
  if (!text.starts_with(header)) return std::nullopt;
  text.remove_prefix(header.size());
  RunFrames result;
  for (std::uint32_t frame = 0; frame < frames; ++frame) {
    std::uint32_t number = 0;
    double update = 0;
    double broad_phase = 0;
    double total = 0;
    std::size_t pairs = 0;
    const bool whole = take(text, number, ',') && take(text, update, ',') && take(text, broad_phase, ',') &&
                       take(text, total, ',') && take(text, pairs, '\n');
    if (!whole || number != frame || !are_sound(update, broad_phase, total)) return std::nullopt;
    result.update.push_back(update);
    result.broad_phase.push_back(broad_phase);
    result.total.push_back(total);
    result.pairs.push_back(pairs);
  }
  return text.empty() ? std::optional(std::move(result)) : std::nullopt;
}

RunSummary summarize_run(const RunFrames& frames) {
  const std::vector<double> totals = without_warm_up(frames.total);
  const std::vector<double> pairs(frames.pairs.begin() + 1, frames.pairs.end());
  return {.update = summarize(without_warm_up(frames.update)),
          .broad_phase = summarize(without_warm_up(frames.broad_phase)),
          .total = summarize(totals),
          .total_sum = std::accumulate(totals.begin(), totals.end(), 0.0),
          .pairs_mean = summarize(pairs).mean,
          .pairs_last = frames.pairs.back(),
          .first_frame_total = frames.total.front()};
}

}  // namespace broadcl::cli
