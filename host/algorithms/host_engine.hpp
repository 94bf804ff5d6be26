#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "algorithms/algorithm.hpp"

namespace broadcl {

/// Finds all pairs of boxes that overlap and may pair, in canonical order, on the host. Where there are
/// filters, there is one for each box.
using FindOnHost =
    std::function<std::vector<Pair>(std::span<const Aabb> boxes, std::span<const Filter> filters)>;

/// An algorithm of the host, which needs no OpenCL, of what finds its pairs. It has no profile.
[[nodiscard]] std::unique_ptr<Algorithm> make_host_engine(FindOnHost find);

}  // namespace broadcl
