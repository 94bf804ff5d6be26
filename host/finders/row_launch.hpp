#pragma once

#include <algorithm>
#include <cstddef>

#include "opencl/context.hpp"

namespace broadcl {

/// Rows per work-item.
/// @param items_of_one_row As many work-items as there would be if each had one row.
[[nodiscard]] inline std::size_t rows_per_item(const opencl::RowLaunch& launch, std::size_t items_of_one_row,
                                               const opencl::Context& context) {
  const std::size_t wanted = std::size_t{context.device().compute_units} * launch.items;
  return std::clamp<std::size_t>(items_of_one_row / wanted, launch.min_rows, launch.max_rows);
}

/// Runs of rows per launch, of n columns.
[[nodiscard]] inline std::size_t runs_at_once(const opencl::RowLaunch& launch, std::size_t rows,
                                              std::size_t n) {
  return std::max<std::size_t>(1, launch.most_tests / (rows * n));
}

}  // namespace broadcl
