#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase64.hpp>

#include "boxes64.hpp"
#include "each_algorithm.hpp"

namespace broadcl::test {

[[nodiscard]] inline Pairs pairs_with(const std::vector<Filter>& filters, const Boxes64& boxes) {
  Pairs pairs = expected_pairs(boxes);
  std::erase_if(pairs, [&](const Pair& pair) { return !may_pair(filters[pair.a], filters[pair.b]); });
  return pairs;
}

/// A BroadPhase64 and the pairs that it must have.
class Exact {
 public:
  explicit Exact(const Config& config, std::size_t frame = 0) : broad_phase_(config), frame_(frame) {}

  /// An update with these boxes, in one of several ways.
  void update(const Boxes64& boxes, const std::string& what) {
    SCOPED_TRACE(what + ", frame " + std::to_string(frame_));
    const Delta delta = give(boxes);
    const Pairs pairs = filters_.empty() ? expected_pairs(boxes) : pairs_with(filters_, boxes);
    Pairs added;
    Pairs removed;
    const auto is_new = [&](const Pair& pair) {
      return recycled_.contains(pair.a) || recycled_.contains(pair.b);
    };
    std::ranges::copy_if(pairs, std::back_inserter(added), [&](const Pair& pair) {
      return is_new(pair) || !std::ranges::binary_search(pairs_, pair);
    });
    std::ranges::copy_if(pairs_, std::back_inserter(removed), [&](const Pair& pair) {
      return is_new(pair) || !std::ranges::binary_search(pairs, pair);
    });
    EXPECT_TRUE(same(delta, added, removed));
    EXPECT_TRUE(same("pairs", broad_phase_.pairs(), pairs));
    pairs_ = pairs;
    recycled_.clear();
    ++frame_;
  }

  /// Removes an object, and adds another one with the same box.
  void recycle(std::uint32_t id) {
    const Aabb64 box = broad_phase_.box(id);
    const Filter filter = broad_phase_.filter(id);
    broad_phase_.remove(id);
    ASSERT_EQ(broad_phase_.add(box, filter), id);
    recycled_.insert(id);
  }

  void set_filters(const std::vector<Filter>& filters) {
    filters_ = filters;
    broad_phase_.map(filters.size());
    for (std::uint32_t id = 0; id < filters.size(); ++id) broad_phase_.set_filter(id, filters[id]);
  }

  [[nodiscard]] const Pairs& pairs() const noexcept { return pairs_; }

 private:
  Delta give(const Boxes64& boxes) {
    if (frame_ % 4 == 0 || broad_phase_.size() != boxes.size()) return broad_phase_.update(boxes);
    if (frame_ % 4 == 1) {
      std::ranges::copy(boxes, broad_phase_.map(boxes.size()).begin());
    } else {
      for (std::uint32_t id = 0; id < boxes.size(); ++id) {
        if (boxes[id] != broad_phase_.box(id)) broad_phase_.move(id, boxes[id]);
      }
    }
    if (frame_ % 4 == 2) broad_phase_.begin();
    return broad_phase_.finish();
  }

  BroadPhase64 broad_phase_;
  std::size_t frame_;
  std::vector<Filter> filters_;
  Pairs pairs_;
  std::set<std::uint32_t> recycled_;  // since the last update
};

}  // namespace broadcl::test
