#pragma once

#include <algorithm>
#include <cstddef>

#include "opencl/context.hpp"

namespace broadcl {

/// Launch parameters of a kernel that tests all pairs: a work-item has the pairs of a few columns with a run
/// of rows.
struct RowLaunch {
  unsigned width;          ///< Columns per work-item.
  unsigned group;          ///< Work-items per work-group.
  unsigned min_rows;       ///< Rows per work-item, at least.
  unsigned max_rows;       ///< And at most.
  unsigned items;          ///< Work-items wanted per compute unit, as far as min_rows and max_rows allow.
  std::size_t most_tests;  ///< Per launch, so that no watchdog ends it.

  /// Rows per work-item.
  /// @param items_of_one_row As many work-items as there would be if each had one row.
  [[nodiscard]] std::size_t rows(std::size_t items_of_one_row, const opencl::Context& context) const {
    const std::size_t wanted = std::size_t{context.device().compute_units} * items;
    return std::clamp<std::size_t>(items_of_one_row / wanted, min_rows, max_rows);
  }
  /// Runs of rows per launch, of n columns.
  [[nodiscard]] std::size_t runs_at_once(std::size_t rows, std::size_t n) const {
    return std::max<std::size_t>(1, most_tests / (rows * n));
  }
};

}  // namespace broadcl
