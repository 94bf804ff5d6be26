#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

#include "base/free_lists.hpp"
#include "base/packed_box.hpp"
#include "base/pair_lists.hpp"
#include "base/parallel.hpp"
#include "base/two_sets.hpp"
#include "engines/host_engine.hpp"
#include "finders/pair_sort.hpp"
#include "finders/tile_search.hpp"

namespace broadcl {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

/// Classes of sizes, which do not share tiles: up to 4 times the median, up to 16 times, and so on. The last
/// class has everything larger, and the objects of all worlds.
constexpr std::size_t size_classes = 4;

/// Up to this many boxes, testing each pair takes less time than sorting and sweeping.
constexpr std::size_t most_unsorted = 16;

/// Boxes are sorted again once the work exceeds this multiple of the work in a new order.
constexpr double stale_growth = 1.25;

/// A search stops at this multiple, because the order has become useless (boxes leapt); then boxes are sorted
/// again.
constexpr double useless = 4;

/// With fewer boxes per thread, starting threads takes longer than they save.
constexpr std::size_t boxes_per_thread = 4096;

/// If at most one in this many boxes changed, only those that changed are searched.
constexpr std::size_t boxes_per_changed = 16;

/// How often, on average, each box may move before the order counts as old, if only changed boxes are
/// searched.
constexpr std::size_t most_moved = 4;

/// More pairs are counted before they are stored, so that memory is not exhausted by a list that is too long
/// in the end.
constexpr std::size_t most_uncounted = std::size_t{1} << 28U;

/// The position of a box in its order.
template <std::size_t axes>
struct Centre {
  std::array<float, axes> at;
  std::uint32_t slot;
};

template <std::size_t axes>
std::size_t widest_axis(std::span<const Centre<axes>> centres) {
  std::array<float, axes> lower = centres.front().at;
  std::array<float, axes> upper = lower;
  for (const Centre<axes>& centre : centres) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      lower[axis] = std::min(lower[axis], centre.at[axis]);
      upper[axis] = std::max(upper[axis], centre.at[axis]);
    }
  }
  if (axes > 3 && lower[axes - 1] < upper[axes - 1]) return axes - 1;  // worlds before places
  std::size_t widest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis) {
    if (upper[axis] - lower[axis] > upper[widest] - lower[widest]) widest = axis;
  }
  return widest;
}

/// Puts boxes into the order of a k-d tree, in which the boxes of each tile are neighbours, and so are the
/// tiles of each node.
/// @param first The tile of the first box.
template <std::size_t axes>
void split(std::span<Centre<axes>> centres, std::size_t first, std::size_t threads) {
  if (centres.size() <= node_size) return;
  const std::size_t axis = widest_axis<axes>(centres);
  const std::size_t end = first + (centres.size() + node_size - 1) / node_size;
  std::size_t second = (first + end) / 2;  // the first tile of the second half
  const std::size_t node = (second + node_size / 2) / node_size * node_size;
  if (node > first && node < end) second = node;
  const auto middle = static_cast<std::ptrdiff_t>((second - first) * node_size);
  std::nth_element(centres.begin(), centres.begin() + middle, centres.end(),
                   [axis](const Centre<axes>& s, const Centre<axes>& t) { return s.at[axis] < t.at[axis]; });
  const std::array halves{centres.first(static_cast<std::size_t>(middle)),
                          centres.subspan(static_cast<std::size_t>(middle))};
  parallel_for(2, threads, [&](std::size_t k, std::size_t /*thread*/) {
    split(halves.at(k), k == 0 ? first : second, threads / 2);
  });
}

/// The number without those of its last bits that a float cannot represent, so that no rounding mode matters.
float exact(std::uint32_t number) {
  constexpr int digits = std::numeric_limits<float>::digits;
  const int lost =
      std::max(std::numeric_limits<std::uint32_t>::digits - std::countl_zero(number), digits) - digits;
  return static_cast<float>(number >> lost << lost);
}

/// A number that a float can represent.
std::uint32_t place_of_set(const Filter& filter) {
  constexpr std::uint32_t most = (1U << 23U) - 1;
  return 2 * std::min(filter.world, most) + TwoSets::set_of(filter);
}

template <std::size_t axes>
Bounds<axes> bounds_of(const Input& input, std::size_t slot) {
  const Aabb& box = input.boxes[slot];
  Bounds<axes> bounds;
  for (std::size_t axis = 0; axis < 3; ++axis) {  // std::ranges::copy() would be a call per corner
    bounds.lower[axis] = box.lower[axis];
    bounds.upper[axis] = box.upper[axis];
  }
  if constexpr (axes > 3) {
    // Several worlds may have the same coordinate; may_pair() distinguishes them.
    const Filter& filter = input.filters[slot];
    const bool is_in_all = filter.world == Filter::all_worlds;
    const float place = exact(input.sets ? place_of_set(filter) : filter.world);
    bounds.lower[3] = is_in_all ? 0 : place;
    bounds.upper[3] = is_in_all ? infinity : place;
  }
  return bounds;
}

template <std::size_t axes>
Centre<axes> centre_of(const Bounds<axes>& bounds, std::uint32_t slot) {
  constexpr float most = std::numeric_limits<float>::max();
  Centre<axes> centre{.at = {}, .slot = slot};
  for (std::size_t axis = 0; axis < axes; ++axis) {
    centre.at[axis] = std::max(bounds.lower[axis], -most) / 2 + std::min(bounds.upper[axis], most) / 2;
  }
  return centre;
}

/// The exponent of the largest edge of a box, as floats store it.
unsigned exponent_of(const Aabb& box) {
  float edge = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) edge = std::max(edge, box.upper[axis] - box.lower[axis]);
  return std::bit_cast<std::uint32_t>(edge) >> 23U;
}

/// The bounds of all children of a node.
template <std::size_t axes>
Bounds<axes> bounds_of(const Node<axes>& node) {
  Bounds<axes> bounds = make_bounds<axes>(infinity, -infinity);
  for (std::size_t k = 0; k < node_size; ++k) extend(bounds, node.get(k));
  return bounds;
}

/// The axis along which the fewest of these overlap.
template <std::size_t axes>
std::size_t best_axis(std::span<const Bounds<axes>> nodes) {
  constexpr std::size_t samples = 16;
  std::array<std::size_t, axes> overlaps{};
  for (std::size_t s = 0; s < nodes.size(); s += nodes.size() / samples + 1) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      const float lower = nodes[s].lower[axis];
      const float upper = nodes[s].upper[axis];
      for (const Bounds<axes>& node : nodes) {
        if (lower <= node.upper[axis] && node.lower[axis] <= upper) ++overlaps[axis];
      }
    }
  }
  return static_cast<std::size_t>(std::ranges::min_element(overlaps) - overlaps.begin());
}

/// Appends child k to the last of some nodes, or to a new one.
template <std::size_t axes>
void append_child(std::vector<Node<axes>>& nodes, std::size_t k, const Bounds<axes>& bounds) {
  if (k % node_size == 0) {
    Node<axes>& node = nodes.emplace_back();
    for (std::size_t child = 0; child < node_size; ++child)
      node.set(child, make_bounds<axes>(not_a_number, not_a_number), no_slot);
  }
  nodes.back().set(k % node_size, bounds, static_cast<std::uint32_t>(k));
}

/// Sweep and prune (Cohen, Lin, Manocha, Ponamgi, "I-COLLIDE: An Interactive and Exact Collision Detection
/// System for Large-Scale Environments", I3D 1995), not of boxes, but of nodes of neighbouring tiles of
/// neighbouring boxes. Where two nodes overlap, their tiles are tested, and where these overlap, their boxes.
class SweepAndPrune final : public HostFinder {
 public:
  explicit SweepAndPrune(std::size_t threads) : threads_(threads) {}

  void find(const Input& input, std::vector<Pair>& pairs) override {
    if (input.boxes.size() <= most_unsorted) {
      sorted_axes_ = 0;
      test_each_pair(input, pairs);
      return;
    }
    axes_of(input) == 4 ? find(four_, input) : find(three_, input);
    lists_.clear();
    for (const Found& found : found_) found.get(lists_);
    sort_pairs_(lists_, input.boxes.size(), threads_of(input.boxes.size()), pairs);
  }

  bool find_known(std::span<const Filter> filters, std::span<const std::uint32_t> changed,
                  std::vector<Pair>& pairs) override {
    if (sorted_axes_ == 0 || changed.size() * boxes_per_changed > places_.size()) return false;
    set_places(changed);
    return sorted_axes_ == 4 ? search_boxes(four_, filters, pairs) : search_boxes(three_, filters, pairs);
  }

  bool find_changed(const Input& input, std::vector<Pair>& pairs) override {
    const std::size_t axes = axes_of(input);
    if (sorted_axes_ != axes || (axes == 4 && four_.sets != input.sets) ||
        input.changed.size() * boxes_per_changed > input.boxes.size() || !is_order_for(input.boxes.size()))
      return false;
    moved_ += input.changed.size();
    if (moved_ > most_moved * input.boxes.size()) sorted_axes_ = 0;
    if (sorted_axes_ == 0) return false;
    return axes == 4 ? find_changed(four_, input, pairs) : find_changed(three_, input, pairs);
  }

  void clear() noexcept override {
    sorted_axes_ = 0;
    free_lists(order_, places_, changed_places_, dirty_, found_, lists_);
    three_ = {};
    four_ = {};
    sort_pairs_ = {};
  }

 private:
  [[nodiscard]] static std::size_t axes_of(const Input& input) { return input.worlds || input.sets ? 4 : 3; }

  /// The filters to test; none if the sets decide.
  [[nodiscard]] static std::span<const Filter> filters_of(const Input& input) {
    return input.sets && input.sets_decide ? std::span<const Filter>() : input.filters;
  }

  [[nodiscard]] std::size_t threads_of(std::size_t boxes) {
    const std::size_t most = boxes / boxes_per_thread;
    if (most < 2) return 1;
    // Asked only now, since the system may have to read a file.
    if (threads_ == 0) threads_ = std::max(1U, std::thread::hardware_concurrency());
    return std::min(most, threads_);
  }

  /// Whether there are not many more slots, or many fewer, than when they were sorted.
  [[nodiscard]] bool is_order_for(std::size_t slots) const {
    return slots <= places_.size() + places_.size() / 4 && places_.size() / 2 <= slots;
  }

  template <std::size_t axes>
  void find(HostTiles<axes>& all, const Input& input) {
    const std::size_t slots = input.boxes.size();
    const std::size_t threads = threads_of(slots);
    const bool is_stale = axes != sorted_axes_ || all.sets != input.sets || !is_order_for(slots) ||
                          static_cast<double>(work_) > stale_growth * static_cast<double>(fresh_work_);
    sorted_axes_ = 0;  // until all is done
    all.sets = input.sets;
    if (is_stale || !search(all, input, threads, useless * static_cast<double>(fresh_work_))) {
      sort<axes>(input, threads);
      (void)search(all, input, threads, std::numeric_limits<double>::infinity());
      fresh_work_ = work_;
    }
    sorted_axes_ = axes;
  }

  /// Finds all pairs, in the current order.
  /// @returns False if that takes too much work.
  template <std::size_t axes>
  bool search(HostTiles<axes>& all, const Input& input, std::size_t threads, double most_work) {
    while (places_.size() < input.boxes.size()) place_next();
    fill(all, input, threads);
    sweep(all);
    return search_all(all, filters_of(input), threads, most_work);
  }

  /// Stores where these slots are, except those that were added and removed since the last search.
  void set_places(std::span<const std::uint32_t> slots) {
    changed_places_.clear();
    for (const std::uint32_t slot : slots) {
      if (slot < places_.size()) changed_places_.push_back(places_[slot]);
    }
  }

  template <std::size_t axes>
  bool find_changed(HostTiles<axes>& all, const Input& input, std::vector<Pair>& pairs);
  template <std::size_t axes>
  bool search_boxes(const HostTiles<axes>& all, std::span<const Filter> filters, std::vector<Pair>& pairs);
  template <std::size_t axes>
  void sort(const Input& input, std::size_t threads);
  void place_next();
  template <std::size_t axes>
  static void store(HostTiles<axes>& all, const Input& input, std::uint32_t slot, std::size_t place);
  template <std::size_t axes>
  void fill(HostTiles<axes>& all, const Input& input, std::size_t threads);
  template <std::size_t axes>
  void sweep(HostTiles<axes>& all);
  template <std::size_t axes>
  bool search_all(const HostTiles<axes>& all, std::span<const Filter> filters, std::size_t threads,
                  double most_work, std::size_t most_stored = most_uncounted);

  std::size_t threads_;                // 0 if there is to be one per processor
  std::vector<std::uint32_t> order_;   // slots by tile; no_slot where a tile has no more
  std::vector<std::uint32_t> places_;  // of slots in this order
  std::size_t sorted_axes_ = 0;        // of the tiles; 0 if they are not as of the last update
  std::size_t moved_ = 0;              // boxes since the order was new that were searched alone
  std::size_t work_ = 0;               // of the last search of all
  std::size_t fresh_work_ = 0;         // of the first one in this order
  HostTiles<3> three_;
  HostTiles<4> four_;
  std::vector<std::uint32_t> changed_places_;  // of slots that changed
  std::vector<std::uint32_t> dirty_;
  std::vector<Found> found_;                  // by each thread
  PairCount count_;                           // of all threads
  std::vector<std::span<const Pair>> lists_;  // of these
  PairSort sort_pairs_;
};

/// Sorts the slots, such that neighbours in space mostly share a tile.
template <std::size_t axes>
void SweepAndPrune::sort(const Input& input, std::size_t threads) {
  const std::span<const Aabb> boxes = input.boxes;
  std::array<std::size_t, 256> exponents{};
  std::size_t rest = 0;
  for (const Aabb& box : boxes) {
    if (is_empty(box)) continue;
    ++exponents[exponent_of(box)];
    ++rest;
  }
  rest /= 2;
  unsigned median = 0;
  while (rest > exponents[median]) rest -= exponents[median++];
  // Empty boxes come last.
  std::array<std::vector<Centre<axes>>, size_classes + 1> classes;
  for (std::uint32_t slot = 0; slot < boxes.size(); ++slot) {
    const Aabb& box = boxes[slot];
    const unsigned exponent = exponent_of(box);
    std::size_t size =
        std::min<std::size_t>(size_classes - 1, exponent < median ? 0 : (exponent - median) / 2);
    if (axes > 3 && input.filters[slot].world == Filter::all_worlds) size = size_classes - 1;
    if (is_empty(box)) size = size_classes;
    classes.at(size).push_back(centre_of(bounds_of<axes>(input, slot), slot));
  }
  order_.clear();
  places_.resize(boxes.size());
  for (std::vector<Centre<axes>>& centres : classes) {
    while (order_.size() % node_size != 0) order_.push_back(no_slot);
    if (&centres != &classes.back()) split(std::span(centres), order_.size() / node_size, threads);
    for (const Centre<axes>& centre : centres) {
      places_[centre.slot] = static_cast<std::uint32_t>(order_.size());
      order_.push_back(centre.slot);
    }
  }
  moved_ = 0;
}

/// Puts the next slot into the last tile, or into a new one.
void SweepAndPrune::place_next() {
  places_.push_back(static_cast<std::uint32_t>(order_.size()));
  order_.push_back(static_cast<std::uint32_t>(places_.size() - 1));
}

/// Stores the box of a slot in its tile.
template <std::size_t axes>
void SweepAndPrune::store(HostTiles<axes>& all, const Input& input, std::uint32_t slot, std::size_t place) {
  const bool exists = slot < input.boxes.size();  // it may be no_slot
  all.tiles[place / node_size].set(
      place % node_size,
      exists ? bounds_of<axes>(input, slot) : make_bounds<axes>(not_a_number, not_a_number), slot);
}

template <std::size_t axes>
void SweepAndPrune::fill(HostTiles<axes>& all, const Input& input, std::size_t threads) {
  const std::size_t tiles = (order_.size() + node_size - 1) / node_size;
  all.tiles.resize(tiles);
  all.bounds.resize(tiles);
  constexpr std::size_t at_once = 64;
  parallel_for((tiles + at_once - 1) / at_once, threads, [&](std::size_t part, std::size_t /*thread*/) {
    for (std::size_t tile = part * at_once; tile < std::min(tiles, (part + 1) * at_once); ++tile) {
      for (std::size_t place = tile * node_size; place < (tile + 1) * node_size; ++place) {
        store(all, input, place < order_.size() ? order_[place] : no_slot, place);
      }
      all.bounds[tile] = bounds_of(all.tiles[tile]);
    }
  });
}

/// Puts the tiles into nodes, and the nodes into the order of the sweep.
template <std::size_t axes>
void SweepAndPrune::sweep(HostTiles<axes>& all) {
  all.nodes.clear();
  for (std::size_t tile = 0; tile < all.tiles.size(); ++tile) append_child(all.nodes, tile, all.bounds[tile]);
  std::vector<Bounds<axes>> bounds;
  for (const Node<axes>& node : all.nodes) bounds.push_back(bounds_of(node));
  all.roots.clear();
  for (std::size_t node = 0; node < bounds.size(); ++node) append_child(all.roots, node, bounds[node]);
  all.axis = best_axis<axes>(bounds);
  all.sweep.resize(bounds.size());
  std::iota(all.sweep.begin(), all.sweep.end(), 0U);
  std::ranges::sort(all.sweep, {}, [&](std::uint32_t node) { return bounds[node].lower[all.axis]; });
}

template <std::size_t axes>
bool SweepAndPrune::search_all(const HostTiles<axes>& all, std::span<const Filter> filters,
                               std::size_t threads, double most_work, std::size_t most_stored) {
  const TileSearch<axes> search = tile_search<axes>();
  found_.resize(std::max(found_.size(), threads));
  count_.count = 0;
  count_.most_stored = most_stored;
  for (Found& found : found_) found.clear(count_);
  std::atomic<std::size_t> work = 0;
  parallel_for(all.nodes.size() * parts_per_node, threads, [&](std::size_t part, std::size_t thread) {
    if (static_cast<double>(work) > most_work) return;
    Found& found = found_[thread];
    const std::size_t before = found.work;
    search.tiles(found, all, part, filters);
    work += found.work - before;
  });
  work_ = work;
  if (static_cast<double>(work_) > most_work) return false;
  for (Found& found : found_) found.end();
  if (count_.count <= most_stored) return true;
  refuse_too_many(count_.count);
  return search_all(all, filters, threads, most_work, most_pairs);
}

/// Finds the pairs of the boxes that changed.
/// @returns False if there are too many pairs to store before they are counted.
template <std::size_t axes>
bool SweepAndPrune::search_boxes(const HostTiles<axes>& all, std::span<const Filter> filters,
                                 std::vector<Pair>& pairs) {
  found_.resize(std::max<std::size_t>(1, found_.size()));
  count_.count = 0;
  count_.most_stored = most_uncounted;
  found_[0].clear(count_);
  tile_search<axes>().boxes(found_[0], all, changed_places_, filters);
  found_[0].end();
  if (count_.count > most_uncounted) return false;
  lists_.clear();
  found_[0].get(lists_);
  pairs.clear();
  for (const std::span<const Pair> list : lists_) pairs.insert(pairs.end(), list.begin(), list.end());
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());  // of two that changed
  return true;
}

template <std::size_t axes>
bool SweepAndPrune::find_changed(HostTiles<axes>& all, const Input& input, std::vector<Pair>& pairs) {
  sorted_axes_ = 0;  // until all is done
  while (places_.size() < input.boxes.size()) {
    place_next();
    if (order_.size() <= all.tiles.size() * node_size) continue;
    const auto tile = static_cast<std::uint32_t>(all.tiles.size());
    append_child(all.tiles, tile * node_size, make_bounds<axes>(not_a_number, not_a_number));
    all.bounds.push_back(make_bounds<axes>(infinity, -infinity));
    if (tile % node_size == 0) append_child(all.roots, all.nodes.size(), all.bounds.back());
    append_child(all.nodes, tile, all.bounds.back());
  }
  set_places(input.changed);
  dirty_.clear();
  for (const std::uint32_t place : changed_places_) {
    store(all, input, order_[place], place);
    dirty_.push_back(place / node_size);
  }
  const auto each_dirty = [&](const auto& update) {
    std::ranges::sort(dirty_);
    dirty_.erase(std::unique(dirty_.begin(), dirty_.end()), dirty_.end());
    for (std::uint32_t& index : dirty_) index = update(index);
  };
  each_dirty([&](std::uint32_t tile) {
    all.bounds[tile] = bounds_of(all.tiles[tile]);
    all.nodes[tile / node_size].set(tile % node_size, all.bounds[tile], tile);
    return static_cast<std::uint32_t>(tile / node_size);
  });
  each_dirty([&](std::uint32_t node) {
    all.roots[node / node_size].set(node % node_size, bounds_of(all.nodes[node]), node);
    return node;
  });
  if (!search_boxes(all, filters_of(input), pairs)) return false;
  sorted_axes_ = axes;
  return true;
}

}  // namespace

AlgorithmPointer make_sweep_and_prune(const Config& config) {
  return make_host_engine(std::make_unique<SweepAndPrune>(config.threads));
}

}  // namespace broadcl
