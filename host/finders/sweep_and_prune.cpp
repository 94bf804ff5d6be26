#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "base/floating_point.hpp"
#include "base/pair_lists.hpp"
#include "base/parallel.hpp"
#include "engines/box_tree.hpp"
#include "engines/host_engine.hpp"
#include "finders/pair_sort.hpp"
#include "finders/ranked_search.hpp"
#include "finders/slot_bounds.hpp"
#include "finders/tile_search.hpp"
#include "finders/tile_sort.hpp"
#include "finders/tile_tree.hpp"

namespace broadcl {
namespace {

/// Up to so many boxes, testing each with all before it takes less time than sorting and sweeping.
constexpr std::size_t most_unsorted = 6 * node_size;
/// So does it if more pairs are found than the square of the boxes divided by this, which need not be sorted
/// then. (But more boxes could have too many pairs.)
constexpr std::size_t square_per_dense = 32;
constexpr std::size_t most_dense = 65'536;

/// With fewer boxes per thread, waking threads takes longer than they save.
constexpr std::size_t boxes_per_thread = 512;
/// If only those that changed are searched:
constexpr std::size_t changed_per_thread = 2048;

/// The search for a box that changed takes about as long as that of so many if all are searched.
constexpr std::size_t boxes_per_changed = 6;
/// A thread takes so many tiles with such boxes at a time.
constexpr std::size_t searched_at_once = 32;

/// Boxes are sorted at once if more than one in this many has to be put into another tile.
constexpr std::size_t boxes_per_inserted = 8;

/// Otherwise a sort is distributed over frames, so that none takes much longer than others: over so many in
/// which all boxes are searched, or such that it takes about as long as the search of those that changed.
constexpr std::size_t frames_per_sort = 3;
constexpr std::size_t comparisons_per_work = 8;
constexpr std::size_t most_frames_per_sort = 64;
constexpr std::size_t work_per_node = 256;  // as long as reading a node

/// More pairs are counted before they are stored, so that memory is not exhausted by a list that is too long
/// in the end.
constexpr std::size_t most_uncounted = std::size_t{1} << 28U;

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

/// When to sort again: as long as a search takes longer than the first one by less than sorting, and what
/// searches have taken longer since, take per search. All in multiples of a search of all boxes.
class OrderAge {
 public:
  /// Records a search.
  /// @param share How long it would take in a new order.
  void add(bool all, std::size_t work, double share) {
    Searches& first = first_.at(all ? 1 : 0);
    searched_ += share;
    if (first.share < least_share) {
      first.work += static_cast<double>(work);
      first.share += share;
      return;
    }
    const double excess = static_cast<double>(work) * first.share / std::max(1.0, first.work) - share;
    sum_ += excess;
    growth_ = all ? std::max(0.0, excess - rate_) : 0;
    rate_ += (excess / share - rate_) * std::min(1.0, share);  // that of few boxes says little
  }

  /// Whether a new order that is begun now will be done in time. (Or the present one may have been poor from
  /// the beginning.)
  [[nodiscard]] bool is_old() const noexcept {
    return (rate_ + frames_per_sort * growth_) * (searched_ + frames_per_sort) >=
               time_to_sort + sum_ + expected() ||
           searched_ >= most_searched;
  }
  /// Whether what searches will take longer until then is as much as sorting at once takes.
  [[nodiscard]] bool is_useless() const noexcept { return expected() >= time_to_sort; }

 private:
  static constexpr double time_to_sort = 0.9;
  static constexpr double most_searched = 64;
  static constexpr double least_share = 0.25;  // of what others are compared with

  [[nodiscard]] double expected() const noexcept {
    return frames_per_sort * rate_ + frames_per_sort * (frames_per_sort + 1) / 2.0 * growth_;
  }

  struct Searches {
    double work = 0;
    double share = 0;
  };
  std::array<Searches, 2> first_;  // of those that changed, and of all boxes
  double searched_ = 0;
  double sum_ = 0;   // of the excess over the first searches
  double rate_ = 0;  // the present excess
  double growth_ = 0;
};

/// Sweep and prune (Cohen, Lin, Manocha, Ponamgi, "I-COLLIDE: An Interactive and Exact Collision Detection
/// System for Large-Scale Environments", I3D 1995), not of boxes, but of nodes of neighbouring tiles of
/// neighbouring boxes. Where two nodes overlap, their tiles are tested, and where these overlap, their boxes.
template <std::size_t axes>
class Sweep {
 public:
  Sweep(const PairRules& rules, Threads threads)
      : tree_(rules.sets, !rules.reaches.empty()), next_tree_(tree_), threads_(std::move(threads)) {}

  [[nodiscard]] bool is_for(const Input& input) noexcept {
    const HostTiles<axes>& all = tree_.tiles();
    return all.sets == input.rules.sets && all.reaches == !input.rules.reaches.empty() &&
           (axes > 3) == (input.rules.worlds || input.rules.sets);
  }
  /// As the functions of HostFinder.
  void find(const Input& input, std::vector<Pair>& pairs) {
    const std::size_t slots = input.boxes.size();
    if (slots <= most_unsorted) {
      is_sorted_ = false;
      return find_unsorted(input, pairs);
    }
    const Threads threads = threads_of(slots);
    update(input.for_tree(), threads, true);
    find_filters(filters_of(input), threads);
    sweep();
    const std::size_t most_sorted =
        slots > most_dense ? most_pairs : slots * slots / square_per_dense * threads.most;
    search_all(filters_of(input), threads, std::min(most_sorted, most_uncounted));
    age_.add(true, work_, 1);
    is_sorted_ = true;
    if (count_.count > most_sorted) {
      reserve_for_writing(pairs, count_.count);
      return find_unsorted(input, pairs);
    }
    if (count_.count > most_uncounted) search_all(filters_of(input), threads, most_pairs);
    sort_pairs_(lists_, slots, threads, pairs);
  }

  bool find_known(std::span<const Filter> filters, std::span<const std::uint32_t> changed,
                  std::vector<Pair>& pairs) {
    return is_sorted_ && search_changed(filters, changed, pairs);
  }

  bool find_changed(const Input& input, std::vector<Pair>& pairs) {
    const std::span<const std::uint32_t> changed = input.changed.slots;
    const std::size_t slots = input.boxes.size();
    if (slots <= node_size) return false;
    update(input.for_tree(), useful_threads(changed.size(), changed_per_thread, threads_), false);
    if (!search_changed(filters_of(input), changed, pairs)) return false;
    age_.add(false, work_,
             static_cast<double>(changed.size() * boxes_per_changed) / static_cast<double>(tree_.size() + 1));
    return is_sorted_ = true;
  }

  /// As the functions of BoxTree.
  void read(const Input& input) {
    const bool all = input.changed.all;
    update(input, all ? threads_of(input.boxes.size()) : 1, all);
    is_sorted_ = true;
  }
  [[nodiscard]] bool is_ready() const noexcept { return is_sorted_; }
  void find(std::span<const QueryBox> queries, HitList& hits) const;
  template <class Box>
  void find(RankedSearch<Box>& search) const {
    ranked_tile_search<axes, Box>()(search, tree_.tiles());
  }

 private:
  /// The filters to test; none if the sets decide.
  [[nodiscard]] static std::span<const Filter> filters_of(const Input& input) {
    return input.rules.sets && input.rules.sets_decide ? std::span<const Filter>() : input.rules.filters;
  }

  [[nodiscard]] Threads threads_of(std::size_t boxes) const {
    return useful_threads(boxes, boxes_per_thread, threads_);
  }

  /// Puts boxes that changed into tiles, and all boxes into new ones if the order is old.
  /// @param all Whether all boxes are to be searched.
  void update(const Input& input, const Threads& threads, bool all) {
    const bool is_sorted = std::exchange(is_sorted_, false);  // until all is done
    if (!is_sorted || (all && (age_.is_useless() || tree_.is_abandoned(input))))
      return sort_at_once(input, threads);
    (void)tree_.read(input, everything, threads);
    const std::span<const std::uint32_t> left = tree_.left();
    const bool begins = !next_order_ && !is_reading_ && (age_.is_old() || tree_.size() < sorted_ / 2);
    const std::size_t work =
        1 + (all ? work_to_sort_ / frames_per_sort
                 : std::max(comparisons_per_work * work_, work_to_sort_ / most_frames_per_sort));
    const std::size_t inserted = left_.size() + left.size() * (begins ? work_to_sort_ / work + 1 : 1);
    if (inserted * boxes_per_inserted > tree_.size()) return sort_at_once(input, threads);
    if (begins) {
      next_order_.emplace(input, threads);
      work_to_sort_ = next_order_->work();
    } else if (next_order_) {
      left_.insert(left_.end(), left.begin(), left.end());
    }
    if (next_order_ && (all || !begins) && next_order_->advance(work, threads)) {
      if (all) return take_order(input, threads);
      start_order(next_tree_, input);
      is_reading_ = true;
    }
    if (is_reading_) {
      for (const std::uint32_t slot : left) next_tree_.take_out(slot);
      if (next_tree_.read(input, all ? everything : 1 + work_ / work_per_node, threads)) {
        std::swap(tree_, next_tree_);
        is_reading_ = false;
      }
    }
    tree_.insert(input);
  }

  void sort_at_once(const Input& input, const Threads& threads) {
    left_.clear();
    next_order_.emplace(input, threads);
    work_to_sort_ = next_order_->work();
    (void)next_order_->advance(everything, threads);
    take_order(input, threads);
  }

  void take_order(const Input& input, const Threads& threads) {
    start_order(tree_, input);
    is_reading_ = false;
    (void)tree_.read(input, everything, threads);
    tree_.insert(input);
  }

  /// Gives the new order to a tree.
  void start_order(TileTree<axes>& tree, const Input& input) {
    tree.start(next_order_->order(), input);
    for (const std::uint32_t slot : left_)
      tree.take_out(slot);  // since it is not where it was when the sort began
    left_.clear();
    is_by_filter_ = next_order_->order().is_by_filter;
    next_order_.reset();
    age_ = {};
    sorted_ = tree.size();
  }

  void find_unsorted(const Input& input, std::vector<Pair>& pairs) {
    const DefaultFloatingPoint as_everywhere;
    unsorted_.sets = tree_.tiles().sets;
    unsorted_.reaches = tree_.tiles().reaches;
    tile_search<axes>(unsorted_.reaches).unsorted(pairs, unsorted_, input, filters_of(input));
  }

  void find_filters(std::span<const Filter> filters, const Threads& threads);
  void sweep();
  void search_all(std::span<const Filter> filters, const Threads& threads, std::size_t most_stored);
  bool search_changed(std::span<const Filter> filters, std::span<const std::uint32_t> slots,
                      std::vector<Pair>& pairs);
  template <class Search>
  void search(std::size_t parts, const Threads& threads, std::size_t most_stored, const Search& search);

  static constexpr std::size_t everything = std::numeric_limits<std::size_t>::max();

  HostTiles<axes> unsorted_;
  TileTree<axes> tree_;
  TileTree<axes> next_tree_;  // in the next order
  bool is_reading_ = false;   // it, in parts
  Threads threads_;           // 0 if there is to be one per processor
  bool is_sorted_ = false;
  OrderAge age_;
  std::size_t sorted_ = 0;                    // boxes
  bool is_by_filter_ = false;                 // whether filters decided which objects share tiles
  std::optional<TileSort<axes>> next_order_;  // that is being made
  std::size_t work_to_sort_ = 0;
  std::vector<std::uint32_t> left_;           // slots whose boxes left their tiles meanwhile
  std::vector<std::uint32_t> changed_;        // by tile, a bit for each box that is searched alone
  std::vector<std::uint32_t> changed_tiles_;  // that have such a box
  std::size_t work_ = 0;                      // of the last search
  std::vector<Found> found_;                  // by each thread
  PairCount count_;                           // of all threads
  std::vector<std::span<const Pair>> lists_;  // of these
  PairSort sort_pairs_;
};

/// Finds what the tiles and nodes may pair with.
template <std::size_t axes>
void Sweep<axes>::find_filters(std::span<const Filter> filters, const Threads& threads) {
  HostTiles<axes>& all = tree_.tiles();
  all.tile_filters.resize(is_by_filter_ && !filters.empty() ? all.tiles.size() : 0);
  if (all.tile_filters.empty()) return;
  all.node_filters.assign(all.nodes.size(), no_filter);
  parallel_for(all.nodes.size(), threads, [&](std::size_t node, std::size_t /*thread*/) {
    const std::size_t end = std::min(all.tiles.size(), (node + 1) * node_size);
    for (std::size_t tile = node * node_size; tile < end; ++tile)
      extend(all.node_filters[node], all.tile_filters[tile] = filter_of(all.tiles[tile], filters));
  });
}

/// Puts the nodes into the order of the sweep.
template <std::size_t axes>
void Sweep<axes>::sweep() {
  HostTiles<axes>& all = tree_.tiles();
  std::vector<Bounds<axes>> bounds;
  for (std::size_t node = 0; node < all.nodes.size(); ++node)
    bounds.push_back(all.roots[node / node_size].get(node % node_size));
  all.axis = best_axis<axes>(bounds);
  all.sweep.resize(bounds.size());
  std::iota(all.sweep.begin(), all.sweep.end(), 0U);
  std::ranges::sort(all.sweep, {}, [&](std::uint32_t node) { return bounds[node].lower[all.axis]; });
}

/// Calls search(found, part) for each part.
template <std::size_t axes>
template <class Search>
void Sweep<axes>::search(std::size_t parts, const Threads& threads, std::size_t most_stored,
                         const Search& search) {
  found_.resize(std::max(found_.size(), threads.most));
  count_.count = 0;
  count_.most_stored = most_stored;
  for (Found& found : found_) found.clear(count_);
  parallel_for(parts, threads, [&](std::size_t part, std::size_t thread) {
    const DefaultFloatingPoint as_everywhere;
    search(found_[thread], part);
  });
  work_ = 0;
  lists_.clear();
  for (Found& found : found_) {
    work_ += found.work;
    found.end();
    found.get(lists_);
  }
}

template <std::size_t axes>
void Sweep<axes>::search_all(std::span<const Filter> filters, const Threads& threads,
                             std::size_t most_stored) {
  const HostTiles<axes>& all = tree_.tiles();
  search(all.nodes.size() * parts_per_node, threads, most_stored, [&](Found& found, std::size_t part) {
    tile_search<axes>(all.reaches).tiles(found, all, part, filters);
  });
  refuse_too_many(count_.count);
}

/// Finds the pairs of some boxes.
/// @returns False if there are too many pairs to store before they are counted.
template <std::size_t axes>
bool Sweep<axes>::search_changed(std::span<const Filter> filters, std::span<const std::uint32_t> slots,
                                 std::vector<Pair>& pairs) {
  for (const std::uint32_t tile : changed_tiles_) changed_[tile] = 0;
  changed_tiles_.clear();
  changed_.resize(tree_.tiles().tiles.size());
  for (const std::uint32_t slot : slots) {
    const std::uint32_t place = tree_.place_of(slot);
    if (place == no_slot) continue;
    std::uint32_t& bits = changed_[place / node_size];
    if (bits == 0) changed_tiles_.push_back(place / node_size);
    bits |= 1U << place % node_size;
  }
  const std::size_t parts = (changed_tiles_.size() + searched_at_once - 1) / searched_at_once;
  const Threads threads = useful_threads(slots.size(), changed_per_thread, threads_);
  search(parts, threads, most_uncounted, [&](Found& found, std::size_t part) {
    const std::size_t end = std::min(changed_tiles_.size(), (part + 1) * searched_at_once);
    for (std::size_t k = part * searched_at_once; k < end; ++k)
      tile_search<axes>(tree_.tiles().reaches)
          .changed(found, tree_.tiles(), changed_, changed_tiles_[k], filters);
  });
  if (count_.count > most_uncounted) return false;
  sort_pairs_(lists_, tree_.slots(), threads, pairs);
  return true;
}

template <std::size_t axes>
void Sweep<axes>::find(std::span<const QueryBox> queries, HitList& hits) const {
  const HostTiles<axes>& all = tree_.tiles();
  QueryTile<axes> tile;
  for (const QueryBox& query : queries) tile.add(query.box, query.reach, bounds_of<axes>(query, all.sets));
  if (tile.hull.lower[0] > tile.hull.upper[0]) return;  // no query has a box; infinite ones would meet that
  tile_search<axes>(all.reaches || tile.any_reach).queries(hits, all, tile);
}

class SweepAndPrune final : public HostFinder, public BoxTree {
 public:
  explicit SweepAndPrune(Threads threads) : threads_(std::move(threads)) {}

  void find(const Input& input, std::vector<Pair>& pairs) override {
    input.rules.worlds || input.rules.sets ? sweep_for<4>(input).find(input, pairs)
                                           : sweep_for<3>(input).find(input, pairs);
  }

  bool find_known(std::span<const Filter> filters, std::span<const std::uint32_t> changed,
                  std::vector<Pair>& pairs) override {
    return with_sweep([&](auto& sweep) { return sweep.find_known(filters, changed, pairs); });
  }

  bool find_changed(const Input& input, std::vector<Pair>& pairs) override {
    return with_sweep([&](auto& sweep) { return sweep.is_for(input) && sweep.find_changed(input, pairs); });
  }

  [[nodiscard]] BoxTree* tree() noexcept override { return this; }
  void read(const Input& input) override {
    input.rules.worlds || input.rules.sets ? sweep_for<4>(input).read(input)
                                           : sweep_for<3>(input).read(input);
  }
  [[nodiscard]] bool is_ready() const noexcept override {
    return with_sweep([](const auto& sweep) { return sweep.is_ready(); });
  }
  void find(std::span<const QueryBox> queries, HitList& hits) const override {
    (void)with_sweep([&](const auto& sweep) {
      sweep.find(queries, hits);
      return true;
    });
  }

  void find(RankedSearch<Aabb>& search) const override { find_ranked(search); }
  void find(RankedSearch<Aabb64>& search) const override { find_ranked(search); }

  // NOLINTNEXTLINE(bugprone-exception-escape): a monostate throws nothing
  void clear() noexcept override { sweep_ = std::monostate(); }

 private:
  template <std::size_t axes>
  Sweep<axes>& sweep_for(const Input& input) {
    auto* sweep = std::get_if<Sweep<axes>>(&sweep_);
    if (sweep != nullptr && sweep->is_for(input)) return *sweep;
    return sweep_.template emplace<Sweep<axes>>(input.rules, threads_);
  }

  template <class Box>
  void find_ranked(RankedSearch<Box>& search) const {
    (void)with_sweep([&](const auto& sweep) {
      sweep.find(search);
      return true;
    });
  }

  template <class Function>
  bool with_sweep(const Function& function) {
    if (auto* sweep = std::get_if<Sweep<3>>(&sweep_)) return function(*sweep);
    if (auto* sweep = std::get_if<Sweep<4>>(&sweep_)) return function(*sweep);
    return false;
  }
  template <class Function>
  [[nodiscard]] bool with_sweep(const Function& function) const {
    return const_cast<SweepAndPrune*>(this)->with_sweep(function);
  }

  Threads threads_;  // 0 if there is to be one per processor
  std::variant<std::monostate, Sweep<3>, Sweep<4>> sweep_;
};

}  // namespace

AlgorithmPointer make_sweep_and_prune(const Threads& threads) {
  return make_host_engine(std::make_unique<SweepAndPrune>(threads), threads);
}

std::unique_ptr<BoxTree> make_box_tree(const Threads& threads) {
  return std::make_unique<SweepAndPrune>(threads);
}

std::vector<std::uint32_t> order_in_space(std::span<const Aabb> boxes, std::span<const Filter> filters,
                                          const Threads& threads) {
  const auto order = [&](auto sort) {
    (void)sort.advance(std::numeric_limits<std::size_t>::max(), threads);
    return std::move(sort.order().slots);
  };
  const Input input{.boxes = boxes, .rules = {.filters = filters}};
  return filters.empty() ? order(TileSort<3>(input, threads)) : order(TileSort<4>(input, threads));
}

}  // namespace broadcl
