#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace broadcl::cli {

/// Summary of a sample.
struct Summary {
  double mean;
  double median;
  double p95;  ///< 95th percentile.
};

/// A quantile (0 to 1) of a sorted, non-empty sample, interpolated between neighbours.
[[nodiscard]] inline double quantile(const std::vector<double>& sorted, double q) {
  const double position = q * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(position);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (position - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

/// Summary of a non-empty sample.
[[nodiscard]] inline Summary summarize(std::vector<double> sample) {
  std::sort(sample.begin(), sample.end());
  const double sum = std::accumulate(sample.begin(), sample.end(), 0.0);
  return {sum / static_cast<double>(sample.size()), quantile(sample, 0.5), quantile(sample, 0.95)};
}

/// The values of a run without frame 0, in which kernels are compiled and memory is allocated; all of them if
/// there is no other frame.
[[nodiscard]] inline std::vector<double> without_warm_up(const std::vector<double>& values) {
  return {values.begin() + (values.size() > 1 ? 1 : 0), values.end()};
}

}  // namespace broadcl::cli
