#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "algorithms/host_engine.hpp"
#include "packed_box.hpp"

namespace broadcl {
namespace {

/// Boxes in the order of their lower bounds along one axis: a box overlaps only those after it whose lower
/// bound does not exceed its upper one (Cohen, Lin, Manocha, Ponamgi, "I-COLLIDE: An Interactive and Exact
/// Collision Detection System for Large-Scale Environments", I3D 1995).
class SweepAndPrune {
 public:
  std::vector<Pair> operator()(std::span<const Aabb> boxes, std::span<const Filter> filters) {
    sort(boxes);
    std::vector<Pair> found;
    for (auto s = order_.begin(); s != order_.end(); ++s) {
      for (auto t = s + 1; t != order_.end() && t->box.lower[axis_] <= s->box.upper[axis_]; ++t) {
        if (!packed_overlaps(s->box, t->box)) continue;
        if (!filters.empty() && !may_pair(filters[s->slot], filters[t->slot])) continue;
        found.push_back({std::min(s->slot, t->slot), std::max(s->slot, t->slot)});
      }
    }
    std::sort(found.begin(), found.end());
    return found;
  }

 private:
  struct Item {
    Aabb box;
    std::uint32_t slot;
  };

  void sort(std::span<const Aabb> boxes) {
    axis_ = widest_axis(boxes);
    order_.clear();
    for (std::uint32_t slot = 0; slot < boxes.size(); ++slot) {
      if (!is_empty(boxes[slot])) order_.push_back({boxes[slot], slot});
    }
    std::sort(order_.begin(), order_.end(),
              [this](const Item& s, const Item& t) { return s.box.lower[axis_] < t.box.lower[axis_]; });
  }

  /// The axis along which lower bounds are spread most, by quartiles, since a few boxes may be anywhere.
  static std::size_t widest_axis(std::span<const Aabb> boxes) {
    std::array<float, 3> spreads{};
    std::vector<float> bounds;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      bounds.clear();
      for (const Aabb& box : boxes) {
        if (std::isfinite(box.lower[axis])) bounds.push_back(box.lower[axis]);
      }
      if (bounds.empty()) continue;
      const auto quartile = static_cast<std::ptrdiff_t>(bounds.size() / 4);
      std::nth_element(bounds.begin(), bounds.begin() + quartile, bounds.end());
      std::nth_element(bounds.begin() + quartile, bounds.end() - 1 - quartile, bounds.end());
      spreads[axis] = bounds.end()[-1 - quartile] - bounds.begin()[quartile];
    }
    return static_cast<std::size_t>(std::max_element(spreads.begin(), spreads.end()) - spreads.begin());
  }

  std::size_t axis_ = 0;
  std::vector<Item> order_;
};

}  // namespace

std::unique_ptr<Algorithm> make_sweep_and_prune(const Config& /*config*/) {
  return make_host_engine(SweepAndPrune());
}

}  // namespace broadcl
