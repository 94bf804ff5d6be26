#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <variant>
#include <vector>

#include "base/free_lists.hpp"
#include "base/pair_lists.hpp"
#include "base/parallel.hpp"
#include "engines/host_engine.hpp"
#include "finders/pair_sort.hpp"
#include "finders/slot_bounds.hpp"
#include "finders/tile_search.hpp"
#include "finders/tile_sort.hpp"

namespace broadcl {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

/// Up to this many boxes, testing each pair takes less time than sorting and sweeping.
constexpr std::size_t most_unsorted = 16;

/// Boxes are sorted again once the work exceeds this multiple of the work in a new order, or after so many
/// searches, since the order may have been poor from the beginning: boxes may leap while it is made.
constexpr double stale_growth = 1.1;
constexpr std::size_t most_frames = 64;

/// Sorting is distributed over so many searches, so that none takes much longer than others.
constexpr std::size_t frames_per_sort = 3;

/// A search stops at this multiple, because the order has become useless (boxes leapt); then boxes are sorted
/// again.
constexpr double useless = 4;

/// With fewer boxes per thread, waking threads takes longer than they save.
constexpr std::size_t boxes_per_thread = 512;

/// If at most one in this many boxes changed, only those that changed are searched.
constexpr std::size_t boxes_per_changed = 16;

/// How often, on average, each box may move before the order counts as old, if only changed boxes are
/// searched.
constexpr std::size_t most_moved = 4;

/// More pairs are counted before they are stored, so that memory is not exhausted by a list that is too long
/// in the end.
constexpr std::size_t most_uncounted = std::size_t{1} << 28U;

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
      for (const Bounds<axes>& node : nodes) {
        overlaps[axis] += static_cast<std::size_t>(
            detail::meet(nodes[s].lower[axis], nodes[s].upper[axis], node.lower[axis], node.upper[axis]));
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
    if (sorted_axes_ == 0 || changed.size() * boxes_per_changed > order_.places.size()) return false;
    set_places(changed);
    return sorted_axes_ == 4 ? search_boxes(four_, filters, pairs) : search_boxes(three_, filters, pairs);
  }

  bool find_changed(const Input& input, std::vector<Pair>& pairs) override {
    const std::size_t axes = axes_of(input);
    if (sorted_axes_ != axes || (axes == 4 && four_.sets != input.rules.sets) ||
        input.changed.slots.size() * boxes_per_changed > input.boxes.size() ||
        !is_order_for(input.boxes.size()))
      return false;
    moved_ += input.changed.slots.size();
    if (moved_ > most_moved * input.boxes.size()) sorted_axes_ = 0;
    if (sorted_axes_ == 0) return false;
    return axes == 4 ? find_changed(four_, input, pairs) : find_changed(three_, input, pairs);
  }

  void clear() noexcept override {  // NOLINT(bugprone-exception-escape): a monostate throws nothing
    sorted_axes_ = 0;
    order_ = {};
    next_order_ = std::monostate();
    free_lists(changed_places_, dirty_, found_, lists_);
    three_ = {};
    four_ = {};
    sort_pairs_ = {};
  }

 private:
  [[nodiscard]] static std::size_t axes_of(const Input& input) {
    return input.rules.worlds || input.rules.sets ? 4 : 3;
  }

  /// The filters to test; none if the sets decide.
  [[nodiscard]] static std::span<const Filter> filters_of(const Input& input) {
    return input.rules.sets && input.rules.sets_decide ? std::span<const Filter>() : input.rules.filters;
  }

  [[nodiscard]] std::size_t threads_of(std::size_t boxes) const {
    return useful_threads(boxes, boxes_per_thread, threads_);
  }

  /// Whether there are not many more slots, or many fewer, than when they were sorted.
  [[nodiscard]] bool is_order_for(std::size_t slots) const {
    const std::size_t sorted = order_.places.size();
    return slots <= sorted + sorted / 4 && sorted / 2 <= slots;
  }

  template <std::size_t axes>
  void find(HostTiles<axes>& all, const Input& input) {
    const std::size_t slots = input.boxes.size();
    const std::size_t threads = threads_of(slots);
    const bool is_sorted = axes == sorted_axes_ && all.sets == input.rules.sets && is_order_for(slots);
    sorted_axes_ = 0;  // until all is done
    all.sets = input.rules.sets;
    bool is_fresh = is_sorted && renew_order<axes>(input, threads);
    if (!is_sorted || !search(all, input, threads, useless * static_cast<double>(fresh_work_))) {
      sort_at_once<axes>(input, threads);
      (void)search(all, input, threads, std::numeric_limits<double>::infinity());
      is_fresh = true;
    }
    if (is_fresh) fresh_work_ = work_;
    sorted_axes_ = axes;
  }

  /// Begins a new order if the present one is old, or goes on with it.
  /// @returns Whether there is a new one.
  template <std::size_t axes>
  bool renew_order(const Input& input, std::size_t threads) {
    auto* next = std::get_if<TileSort<axes>>(&next_order_);
    ++frames_;
    if (next == nullptr) {
      if (frames_ < most_frames &&
          static_cast<double>(work_) <= stale_growth * static_cast<double>(fresh_work_))
        return false;
      next = &next_order_.template emplace<TileSort<axes>>(input, threads);
      work_per_frame_ = next->work() / frames_per_sort;
    }
    if (!next->advance(work_per_frame_, threads)) return false;
    take_order(*next);
    return true;
  }

  template <std::size_t axes>
  void sort_at_once(const Input& input, std::size_t threads) {
    next_order_ = std::monostate();
    TileSort<axes> sort(input, threads);
    (void)sort.advance(std::numeric_limits<std::size_t>::max(), threads);
    take_order(sort);
  }

  template <std::size_t axes>
  void take_order(TileSort<axes>& sort) {
    std::swap(order_, sort.order());
    next_order_ = std::monostate();
    moved_ = frames_ = 0;
  }

  /// Finds all pairs, in the current order.
  /// @returns False if that takes too much work.
  template <std::size_t axes>
  bool search(HostTiles<axes>& all, const Input& input, std::size_t threads, double most_work) {
    while (order_.places.size() < input.boxes.size()) order_.append();
    fill(all, input, threads);
    sweep(all);
    return search_all(all, filters_of(input), threads, most_work);
  }

  /// Stores where these slots are, except those that were added and removed since the last search.
  void set_places(std::span<const std::uint32_t> slots) {
    changed_places_.clear();
    for (const std::uint32_t slot : slots) {
      if (slot < order_.places.size()) changed_places_.push_back(order_.places[slot]);
    }
  }

  template <std::size_t axes>
  bool find_changed(HostTiles<axes>& all, const Input& input, std::vector<Pair>& pairs);
  template <std::size_t axes>
  bool search_boxes(const HostTiles<axes>& all, std::span<const Filter> filters, std::vector<Pair>& pairs);
  template <std::size_t axes>
  static void store(HostTiles<axes>& all, const Input& input, std::uint32_t slot, std::size_t place);
  template <std::size_t axes>
  void fill(HostTiles<axes>& all, const Input& input, std::size_t threads);
  template <std::size_t axes>
  void sweep(HostTiles<axes>& all);
  template <std::size_t axes>
  bool search_all(const HostTiles<axes>& all, std::span<const Filter> filters, std::size_t threads,
                  double most_work, std::size_t most_stored = most_uncounted);

  std::size_t threads_;  // 0 if there is to be one per processor
  TileOrder order_;
  std::size_t sorted_axes_ = 0;  // of the tiles; 0 if they are not as of the last update
  std::variant<std::monostate, TileSort<3>, TileSort<4>> next_order_;  // that is being made
  std::size_t work_per_frame_ = 0;                                     // to make it
  std::size_t frames_ = 0;      // searches of all since the order was new
  std::size_t moved_ = 0;       // boxes since then that were searched alone
  std::size_t work_ = 0;        // of the last search of all
  std::size_t fresh_work_ = 0;  // of the first one in this order
  HostTiles<3> three_;
  HostTiles<4> four_;
  std::vector<std::uint32_t> changed_places_;  // of slots that changed
  std::vector<std::uint32_t> dirty_;
  std::vector<Found> found_;                  // by each thread
  PairCount count_;                           // of all threads
  std::vector<std::span<const Pair>> lists_;  // of these
  PairSort sort_pairs_;
};

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
  const std::size_t tiles = (order_.slots.size() + node_size - 1) / node_size;
  all.tiles.resize(tiles);
  all.bounds.resize(tiles);
  constexpr std::size_t at_once = 8;
  const std::span<const std::uint32_t> slots = order_.slots;
  parallel_for((tiles + at_once - 1) / at_once, threads, [&](std::size_t part, std::size_t /*thread*/) {
    for (std::size_t tile = part * at_once; tile < std::min(tiles, (part + 1) * at_once); ++tile) {
      for (std::size_t place = tile * node_size; place < (tile + 1) * node_size; ++place) {
        store(all, input, place < slots.size() ? slots[place] : no_slot, place);
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
  while (order_.places.size() < input.boxes.size()) {
    order_.append();
    if (order_.slots.size() <= all.tiles.size() * node_size) continue;
    const auto tile = static_cast<std::uint32_t>(all.tiles.size());
    append_child(all.tiles, tile * node_size, make_bounds<axes>(not_a_number, not_a_number));
    all.bounds.push_back(make_bounds<axes>(infinity, -infinity));
    if (tile % node_size == 0) append_child(all.roots, all.nodes.size(), all.bounds.back());
    append_child(all.nodes, tile, all.bounds.back());
  }
  set_places(input.changed.slots);
  dirty_.clear();
  for (const std::uint32_t place : changed_places_) {
    store(all, input, order_.slots[place], place);
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
  return make_host_engine(std::make_unique<SweepAndPrune>(config.threads), config.threads);
}

}  // namespace broadcl
