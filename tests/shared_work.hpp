#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <random>
#include <span>
#include <type_traits>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

namespace broadcl::test {

using Numbers = std::vector<std::uint32_t>;

/// Enough boxes for three threads, and about as many pairs.
template <class Box>
std::vector<Box> many_boxes(unsigned seed) {
  using Bound = typename decltype(Box::lower)::value_type;
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> coordinate(0, 1);
  std::vector<Box> boxes(14'000);
  for (Box& box : boxes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = static_cast<Bound>(coordinate(random));
      box.upper[axis] = box.lower[axis] + static_cast<Bound>(0.05F * coordinate(random));
    }
  }
  return boxes;
}

/// Makes all calls that several threads may share, one after the other.
/// @param after Called after each.
/// @returns What they return.
template <class Box>
std::vector<Numbers> shared_work(
    const Config& config, const std::function<void(const char* call)>& after = [](const char*) {}) {
  std::vector<Numbers> results;
  const auto add = [&](const char* call, std::span<const Pair> pairs) {
    Numbers& numbers = results.emplace_back();
    for (const auto& [a, b] : pairs) numbers.insert(numbers.end(), {a, b});
    after(call);
  };
  const auto add_changes = [&](const char* call, const Delta& delta) {
    add("", delta.added);
    add(call, delta.removed);
  };
  const auto add_hits = [&](const char* call, const Hits& hits) {
    results.push_back(hits.ids);
    after(call);
  };
  const std::vector<Box> first = many_boxes<Box>(1);
  const std::vector<Box> second = many_boxes<Box>(2);
  {
    BasicBroadPhase<Box> broad_phase(config);
    const Numbers ids = broad_phase.add(first);
    after("add");
    add_changes("update", broad_phase.update());
    add_changes("update(boxes)", broad_phase.update(second));
    broad_phase.begin(first);
    add_changes("finish", broad_phase.finish());
    broad_phase.move(ids, second);
    after("move");
    add_hits("overlapping", broad_phase.overlapping(first));
    add_hits("nearest", broad_phase.nearest(first, {.limit = 2}));
    std::ranges::copy(first, broad_phase.map(first.size()).begin());
    add_changes("map", broad_phase.update());
  }
  const std::vector<Pair> pairs = overlapping_pairs(first, {}, config);
  add("overlapping_pairs", pairs);
  add("of two sets", overlapping_pairs(first, second, {}, config));
  add_hits("overlapping, once", overlapping(first, second, {}, config));
  Numbers squares;
  for (const double square : squared_distances(first, second, pairs, config))
    squares.push_back(static_cast<std::uint32_t>(square * 1e9));
  results.push_back(squares);
  after("squared_distances");
  return results;
}

}  // namespace broadcl::test
