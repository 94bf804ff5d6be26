#include "finders/tile_sort.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <memory>
#include <type_traits>
#include <utility>

#include "base/box_parts.hpp"
#include "base/parallel.hpp"
#include "base/system.hpp"
#include "finders/slot_bounds.hpp"
#include "finders/tile_classes.hpp"
#include "finders/tile_search.hpp"

namespace broadcl {
namespace {

/// Nodes of up to so many boxes are sorted in one step, by one thread.
constexpr std::size_t sorted_at_once = node_size * node_size;

/// How many times a node of so many boxes is divided.
std::size_t levels_of(std::size_t boxes) {
  return static_cast<std::size_t>(std::bit_width(boxes / node_size));
}

/// An integer that compares as the number does.
std::int32_t key_of(float number) {
  const auto bits = std::bit_cast<std::int32_t>(number);
  return bits ^ (bits >> 31 & std::numeric_limits<std::int32_t>::max());
}

/// Divides keys in two: those less than `key`, and the first `equal` of those equal to it, come first.
struct Cut {
  std::int32_t key;
  std::size_t equal;
};

/// @returns The least and the greatest of the keys from a lower limit up to below an upper one.
std::pair<std::int64_t, std::int64_t> range_within(std::span<const std::int32_t> keys, std::int64_t lower,
                                                   std::int64_t upper) {
  std::int64_t least = upper;
  std::int64_t greatest = lower;
  for (const std::int32_t key : keys) {
    if (key < lower || key >= upper) continue;
    least = std::min<std::int64_t>(least, key);
    greatest = std::max<std::int64_t>(greatest, key);
  }
  return {least, greatest};
}

/// @returns The cut before which `first` of the keys are, more than none and fewer than all.
Cut cut_after(std::span<const std::int32_t> keys, std::size_t first) {
  const auto count_below = [&](std::int64_t limit) {
    std::uint32_t count = 0;  // 32 bits, so that one instruction counts several of the keys
    for (const std::int32_t key : keys)
      count += static_cast<std::uint32_t>(key < static_cast<std::int32_t>(limit));
    return std::size_t{count};
  };
  // At most `first` keys are below the lower limit, and more, or all, below the upper one.
  std::int64_t lower = std::numeric_limits<std::int32_t>::min();
  std::int64_t upper = std::int64_t{std::numeric_limits<std::int32_t>::max()} + 1;
  std::size_t below_lower = 0;
  std::size_t below_upper = keys.size();
  std::array<std::int32_t, 16> sample;
  for (std::size_t k = 0; k < sample.size(); ++k) sample.at(k) = keys[k * keys.size() / sample.size()];
  std::ranges::sort(sample);
  const std::size_t near = std::clamp<std::size_t>(first * sample.size() / keys.size(), 2, sample.size() - 3);
  for (std::size_t step = 0; upper - lower > 1; ++step) {
    if (step % 16 == 15) {  // keys may be few numbers, far apart
      const auto [least, most] = range_within(keys, lower, upper);
      lower = least;
      upper = most + 1;
      if (upper - lower == 1) break;
    }
    std::int64_t limit = (lower + upper) / 2;
    if (step < 2) {
      limit = sample.at(step == 0 ? near - 2 : near + 2);
    } else if (step % 4 != 0) {  // as if keys were evenly distributed
      limit = lower + static_cast<std::int64_t>(static_cast<double>(upper - lower) *
                                                static_cast<double>(first - below_lower) /
                                                static_cast<double>(below_upper - below_lower));
    }
    limit = std::clamp(limit, lower + 1, upper - 1);
    const std::size_t below = count_below(limit);
    if (below == first) return {.key = static_cast<std::int32_t>(limit), .equal = 0};
    (below < first ? lower : upper) = limit;
    (below < first ? below_lower : below_upper) = below;
  }
  return {.key = static_cast<std::int32_t>(lower), .equal = first - below_lower};
}

}  // namespace

template <std::size_t axes>
TileSort<axes>::TileSort(const Input& input, const Threads& threads) {
  const std::size_t slots = input.boxes.size();
  const TileClasses classes(input);
  using Positions = std::array<std::size_t, TileClasses::count + 1>;
  std::vector<Positions> next(parts_of(slots));  // of each part, in each class
  const auto for_slots = [&](const auto& function) {
    for_each_part(slots, threads, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
      for (std::size_t slot = begin; slot < end; ++slot) function(next[begin / boxes_per_part], slot);
    });
  };
  std::vector<std::uint8_t> class_by_slot(slots);
  for_slots(
      [&](Positions& counts, std::size_t slot) { ++counts.at(class_by_slot[slot] = classes.of(slot)); });
  std::array<std::size_t, TileClasses::count + 1> starts{};
  for (std::size_t k = 0; k < TileClasses::count; ++k) {
    starts.at(k + 1) = starts.at(k);
    for (Positions& positions : next) starts.at(k + 1) += std::exchange(positions.at(k), starts.at(k + 1));
  }

  const std::size_t boxes = starts.back();
  const auto allocate = [&](auto& array) {
    using Array = std::remove_reference_t<decltype(array)>;
    array =
        std::make_unique_for_overwrite<typename Array::element_type[]>(boxes);  // NOLINT(*-avoid-c-arrays)
    use_large_pages(array.get(), boxes * sizeof(typename Array::element_type));
  };
  allocate(centres_);
  allocate(others_);
  allocate(keys_);
  for_slots([&](Positions& positions, std::size_t slot) {
    if (class_by_slot[slot] == TileClasses::none) return;
    const Bounds<axes> bounds = bounds_of<axes>(input, slot);
    Centre& centre = centres_[positions.at(class_by_slot[slot])++];
    centre.slot = static_cast<std::uint32_t>(slot);
    for (std::size_t axis = 0; axis < axes; ++axis) centre.at[axis] = centre_of(bounds, axis);
  });

  order_.places.resize(slots, no_slot);
  order_.is_by_filter = classes.are_by_filter();
  for (std::size_t k = 0; k < TileClasses::count; ++k) {
    const std::size_t begin = starts.at(k);
    const std::size_t count = starts.at(k + 1) - begin;
    if (count == 0) continue;
    const std::size_t first = order_.slots.size();
    order_.slots.resize(first + count);
    order_.slots.resize((order_.slots.size() + node_size - 1) / node_size * node_size, no_slot);
    pending_.push_back({{centres_.get() + begin, count},
                        {others_.get() + begin, count},
                        {keys_.get() + begin, count},
                        first});
  }
}

template <std::size_t axes>
std::size_t TileSort<axes>::work() const noexcept {
  std::size_t work = 0;
  for (const Node& node : pending_) work += node.from.size() * levels_of(node.from.size());
  return work;
}

template <std::size_t axes>
bool TileSort<axes>::advance(std::size_t work, const Threads& threads) {
  std::size_t done = 0;
  while (!pending_.empty() && (done == 0 || done < work)) {
    std::size_t count = 0;
    std::size_t next = done;
    while (count < pending_.size() && (count == 0 || next < work)) next += work_of(pending_[count++]);
    std::vector<std::array<Node, 2>> halves(count);
    parallel_for(count, threads, [&](std::size_t k, std::size_t /*thread*/) {
      const Node& node = pending_[k];
      if (node.from.size() <= sorted_at_once) return sort(node);
      halves[k] = halves_of(node);
    });
    pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(count));
    for (const std::array<Node, 2>& both : halves) {
      if (!both[0].from.empty()) pending_.insert(pending_.end(), both.begin(), both.end());
    }
    done = next;
  }
  return pending_.empty();
}

/// The work of sort() or halves_of(), whichever is to be called.
template <std::size_t axes>
std::size_t TileSort<axes>::work_of(const Node& node) noexcept {
  const std::size_t size = node.from.size();
  return size * (size <= sorted_at_once ? levels_of(size) : 1);
}

template <std::size_t axes>
void TileSort<axes>::sort(const Node& node) {
  if (node.from.size() <= node_size) return place(node.from, node.first);
  for (const Node& half : halves_of(node)) sort(half);
}

/// Puts boxes where they belong, in this order.
template <std::size_t axes>
void TileSort<axes>::place(std::span<const Centre> centres, std::size_t first) {
  for (const Centre& centre : centres) {
    order_.places[centre.slot] = static_cast<std::uint32_t>(first);
    order_.slots[first++] = centre.slot;
  }
}

/// Divides a node into two of whole tiles and, if possible, whole nodes and roots.
template <std::size_t axes>
auto TileSort<axes>::halves_of(const Node& node) -> std::array<Node, 2> {
  const std::size_t first = node.first / node_size;  // tile
  const std::size_t end = first + (node.from.size() + node_size - 1) / node_size;
  const std::size_t half = (first + end) / 2;
  std::size_t second = half;
  for (const std::size_t size : {node_size, node_size * node_size}) {
    const std::size_t aligned = (half + size / 2) / size * size;
    if (aligned > first && aligned < end) second = aligned;
  }
  const std::size_t middle = (second - first) * node_size;
  partition(node, middle);
  return {Node{node.to.first(middle), node.from.first(middle), node.keys.first(middle), node.first},
          Node{node.to.subspan(middle), node.from.subspan(middle), node.keys.subspan(middle),
               node.first + middle}};
}

/// The axis along which a sample of some centres extends farthest.
template <std::size_t axes>
std::size_t TileSort<axes>::widest_axis(std::span<const Centre> centres) {
  constexpr std::size_t samples = 256;
  std::array<float, axes> lower = centres.front().at;
  std::array<float, axes> upper = lower;
  for (std::size_t k = 0; k < centres.size(); k += centres.size() / samples + 1) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      lower[axis] = std::min(lower[axis], centres[k].at[axis]);
      upper[axis] = std::max(upper[axis], centres[k].at[axis]);
    }
  }
  if (axes > 3 && lower[axes - 1] < upper[axes - 1]) return axes - 1;  // worlds before places
  std::size_t widest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis) {
    if (upper[axis] - lower[axis] > upper[widest] - lower[widest]) widest = axis;
  }
  return widest;
}

/// Moves the centres, those before the middle along the widest axis first. Has no branches that depend on the
/// boxes, as in "Super Scalar Sample Sort" (Sanders, Winkel, ESA 2004).
template <std::size_t axes>
void TileSort<axes>::partition(const Node& node, std::size_t middle) {
  const std::span<const Centre> from = node.from;
  const std::span<std::int32_t> keys = node.keys;
  const std::size_t axis = widest_axis(from);
  for (std::size_t k = 0; k < from.size(); ++k) keys[k] = key_of(from[k].at[axis]);
  const Cut cut = cut_after(keys, middle);
  const std::int32_t limit = cut.key;
  std::size_t equal_left = cut.equal;
  std::size_t next = 0;  // of the first half
  const auto move_all = [&](const auto& is_in_first_half) {
    for (std::size_t k = 0; k < from.size(); ++k) {
      const std::size_t is_first = is_in_first_half(keys[k]);
      const std::size_t other = middle + k - next;
      node.to[other ^ ((other ^ next) & (0 - is_first))] = from[k];
      next += is_first;
    }
  };
  const auto is_below = [&](std::int32_t key) { return static_cast<std::size_t>(key < limit); };
  if (equal_left == 0) return move_all(is_below);
  move_all([&](std::int32_t key) {
    const std::size_t equal =
        static_cast<std::size_t>(key == limit) & static_cast<std::size_t>(equal_left > 0);
    equal_left -= equal;
    return is_below(key) | equal;
  });
}

template class TileSort<3>;
template class TileSort<4>;

}  // namespace broadcl
