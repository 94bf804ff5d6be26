#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "algorithms/algorithm.hpp"

namespace broadcl {

/// Finds all pairs of boxes that overlap and may pair, on the host, and puts them into `pairs` in canonical
/// order. `filters` is empty, or has one filter per box.
using FindOnHost = std::function<void(std::span<const Aabb> boxes, std::span<const Filter> filters,
                                      std::vector<Pair>& pairs)>;

/// Makes an algorithm of the host from the function that finds its pairs. It needs no OpenCL and has no
/// profile.
[[nodiscard]] std::unique_ptr<Algorithm> make_host_engine(FindOnHost find);

}  // namespace broadcl
