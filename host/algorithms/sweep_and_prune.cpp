#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <future>
#include <limits>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "algorithms/host_engine.hpp"
#include "algorithms/pair_sort.hpp"
#include "packed_box.hpp"
#include "parallel.hpp"

namespace broadcl {
namespace {

/// Boxes per tile, and tiles per node: as many as a word has bits.
constexpr std::size_t node_size = 32;
constexpr std::uint32_t no_slot = 0xffffffff;
constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

/// Classes of sizes, which do not share tiles: up to 4 times the median, up to 16 times, and so on. The last
/// class has everything larger, and the objects of all worlds.
constexpr std::size_t size_classes = 4;

/// The order is made anew once the work exceeds this multiple of the work in a new order.
constexpr double stale = 1.25;

/// With fewer boxes, starting threads takes longer than what they save.
constexpr std::size_t fewest_for_threads = 2048;
constexpr std::size_t tiles_at_once = 8;

/// Lower and upper bounds along each axis. If objects are in different worlds, these are a fourth axis.
template <std::size_t axes>
struct Bounds {
  std::array<float, axes> lower, upper;
};

template <std::size_t axes>
Bounds<axes> make_bounds(float lower, float upper) {
  Bounds<axes> bounds;
  bounds.lower.fill(lower);
  bounds.upper.fill(upper);
  return bounds;
}

template <std::size_t axes>
void extend(Bounds<axes>& bounds, const Bounds<axes>& by) {
  for (std::size_t axis = 0; axis < axes; ++axis) {  // NaN changes nothing
    bounds.lower[axis] = by.lower[axis] < bounds.lower[axis] ? by.lower[axis] : bounds.lower[axis];
    bounds.upper[axis] = by.upper[axis] > bounds.upper[axis] ? by.upper[axis] : bounds.upper[axis];
  }
}

/// The bounds of boxes or of tiles, by component, so that one instruction compares several of them. NaN where
/// there is none.
template <std::size_t axes>
struct alignas(64) Node {
  std::array<std::array<float, node_size>, axes> lower, upper;
  std::array<std::uint32_t, node_size> index;  // slots or tiles

  void set(std::size_t k, const Bounds<axes>& bounds, std::uint32_t index_of_k) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      lower[axis][k] = bounds.lower[axis];
      upper[axis][k] = bounds.upper[axis];
    }
    index[k] = index_of_k;
  }
  [[nodiscard]] Bounds<axes> get(std::size_t k) const {
    Bounds<axes> bounds;
    for (std::size_t axis = 0; axis < axes; ++axis) {
      bounds.lower[axis] = lower[axis][k];
      bounds.upper[axis] = upper[axis][k];
    }
    return bounds;
  }
};

// What follows is compiled twice, for any processor and for those with AVX2, so it must be inlined.
#define BROADCL_INLINE [[gnu::always_inline]] inline

constexpr std::array<std::uint32_t, node_size> bit_of = [] {
  std::array<std::uint32_t, node_size> bits{};
  for (std::size_t k = 0; k < node_size; ++k) bits[k] = 1U << k;
  return bits;
}();

/// One bit per child of a node: whether it overlaps these bounds.
template <std::size_t axes>
BROADCL_INLINE std::uint32_t overlapping(const Node<axes>& node, const Bounds<axes>& bounds) {
  std::uint32_t bits = 0;
  for (std::size_t k = 0; k < node_size; ++k) {
    bool overlaps = true;
    for (std::size_t axis = 0; axis < axes; ++axis) {
      overlaps = overlaps & (node.lower[axis][k] <= bounds.upper[axis]) &
                 (bounds.lower[axis] <= node.upper[axis][k]);
    }
    bits |= overlaps ? bit_of[k] : 0;
  }
  return bits;
}

/// Boxes in tiles, under nodes of tiles that are in the order of a sweep.
template <std::size_t axes>
struct Tiles {
  std::vector<Node<axes>> tiles;
  std::vector<Bounds<axes>> bounds;  // of the tiles
  std::vector<Node<axes>> nodes;
  std::size_t axis = 0;  // of the sweep: lower bounds of tiles ascend along it
};

/// What a thread finds.
struct Found {
  std::vector<Pair> pairs;  // of which the first `count` were found
  std::size_t count = 0;
  std::size_t work = 0;
};

/// Appends the pairs of box k of a tile with some boxes of another.
template <std::size_t axes>
BROADCL_INLINE void append(Found& found, const Node<axes>& tile, std::uint32_t bits, std::uint32_t other,
                           std::span<const Filter> filters) {
  for (; bits != 0; bits &= bits - 1) {
    const std::uint32_t slot = tile.index[static_cast<std::size_t>(std::countr_zero(bits))];
    if (!filters.empty() && !may_pair(filters[slot], filters[other])) continue;
    found.pairs[found.count++] = {std::min(slot, other), std::max(slot, other)};
  }
}

/// Tests the boxes of two tiles.
template <std::size_t axes>
BROADCL_INLINE void test(Found& found, const Tiles<axes>& all, std::size_t s, std::size_t t,
                         std::span<const Filter> filters) {
  const std::uint32_t of_s = overlapping(all.tiles[s], all.bounds[t]);
  if (of_s == 0) return;
  const std::uint32_t of_t = overlapping(all.tiles[t], all.bounds[s]);
  const bool few_in_s = std::popcount(of_s) < std::popcount(of_t);
  const Node<axes>& few = all.tiles[few_in_s ? s : t];
  const Node<axes>& many = all.tiles[few_in_s ? t : s];
  for (std::uint32_t bits = few_in_s ? of_s : of_t; bits != 0; bits &= bits - 1) {
    const auto k = static_cast<std::size_t>(std::countr_zero(bits));
    append(found, many, overlapping(many, few.get(k)), few.index[k], filters);
  }
}

/// Tests a tile with itself and with those after it in the sweep whose lower bounds do not exceed its upper
/// one.
template <std::size_t axes>
BROADCL_INLINE void search(Found& found, const Tiles<axes>& all, std::size_t position,
                           std::span<const Filter> filters) {
  const auto reserve = [&] {
    constexpr std::size_t most = node_size * node_size;  // pairs of two tiles
    if (found.pairs.size() < found.count + most) found.pairs.resize(2 * found.pairs.size() + most);
  };
  const std::size_t first = position / node_size;
  const std::size_t s = all.nodes[first].index[position % node_size];
  const Node<axes>& tile = all.tiles[s];
  const Bounds<axes> bounds = all.bounds[s];
  reserve();
  for (std::size_t k = 1; k < node_size; ++k) {
    append(found, tile, overlapping(tile, tile.get(k)) & (bit_of[k] - 1), tile.index[k], filters);
  }
  std::uint32_t after = 0xfffffffeU << position % node_size;
  std::size_t node = first;
  do {
    for (std::uint32_t bits = overlapping(all.nodes[node], bounds) & after; bits != 0; bits &= bits - 1) {
      reserve();
      ++found.work;
      test(found, all, s, all.nodes[node].index[static_cast<std::size_t>(std::countr_zero(bits))], filters);
    }
    after = 0xffffffff;
    ++node;
  } while (node < all.nodes.size() && all.nodes[node].lower[all.axis][0] <= bounds.upper[all.axis]);
}

template <std::size_t axes>
using SearchRange = void (*)(Found& found, const Tiles<axes>& all, std::size_t begin, std::size_t end,
                             std::span<const Filter> filters);

template <std::size_t axes>
void search_range(Found& found, const Tiles<axes>& all, std::size_t begin, std::size_t end,
                  std::span<const Filter> filters) {
  for (std::size_t position = begin; position < end; ++position) search(found, all, position, filters);
}

#if defined(__x86_64__) && defined(__GNUC__)
template <std::size_t axes>
[[gnu::target("avx2")]] void search_range_avx2(Found& found, const Tiles<axes>& all, std::size_t begin,
                                               std::size_t end, std::span<const Filter> filters) {
  for (std::size_t position = begin; position < end; ++position) search(found, all, position, filters);
}
template <std::size_t axes>
SearchRange<axes> best_search() {
  return __builtin_cpu_supports("avx2") != 0 ? search_range_avx2<axes> : search_range<axes>;
}
#else
template <std::size_t axes>
SearchRange<axes> best_search() {
  return search_range<axes>;
}
#endif

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

/// Puts boxes into an order in which each run of node_size is compact, as a k-d tree has them.
template <std::size_t axes>
void split(std::span<Centre<axes>> centres, std::size_t threads) {
  if (centres.size() <= node_size) return;
  const std::size_t axis = widest_axis<axes>(centres);
  const std::size_t tiles = (centres.size() + node_size - 1) / node_size;
  const auto middle = static_cast<std::ptrdiff_t>(tiles / 2 * node_size);
  std::nth_element(centres.begin(), centres.begin() + middle, centres.end(),
                   [axis](const Centre<axes>& s, const Centre<axes>& t) { return s.at[axis] < t.at[axis]; });
  const std::array halves{centres.first(static_cast<std::size_t>(middle)),
                          centres.subspan(static_cast<std::size_t>(middle))};
  const std::size_t share = centres.size() < fewest_for_threads ? 1 : threads;
  parallel_for(2, share, [&](std::size_t k, std::size_t /*thread*/) { split(halves.at(k), share / 2); });
}

template <std::size_t axes>
Bounds<axes> bounds_of(const Aabb& box, std::span<const Filter> filters, std::size_t slot) {
  Bounds<axes> bounds;
  std::ranges::copy(box.lower, bounds.lower.begin());
  std::ranges::copy(box.upper, bounds.upper.begin());
  if constexpr (axes > 3) {
    // Rounded, so that a few worlds may seem to be one: may_pair() knows better.
    const std::uint32_t world = filters[slot].world;
    const bool is_in_all = world == Filter::all_worlds;
    bounds.lower[3] = is_in_all ? 0 : static_cast<float>(world);
    bounds.upper[3] = is_in_all ? infinity : static_cast<float>(world);
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

/// Sweep and prune (Cohen, Lin, Manocha, Ponamgi, "I-COLLIDE: An Interactive and Exact Collision Detection
/// System for Large-Scale Environments", I3D 1995), not of boxes, but of tiles of neighbouring boxes, which
/// are then tested with each other.
class SweepAndPrune {
 public:
  explicit SweepAndPrune(std::size_t threads)
      : threads_(threads > 0 ? threads : std::max(1U, std::thread::hardware_concurrency())) {}

  void operator()(std::span<const Aabb> boxes, std::span<const Filter> filters, std::vector<Pair>& pairs) {
    const bool worlds =
        std::ranges::any_of(filters, [&](const Filter& f) { return f.world != filters[0].world; });
    worlds ? find(four_, boxes, filters) : find(three_, boxes, filters);
    std::vector<std::span<const Pair>> lists;
    for (const Found& found : found_) lists.emplace_back(found.pairs.data(), found.count);
    sort_pairs_(lists, boxes.size(), threads_of(boxes.size()), pairs);
  }

 private:
  [[nodiscard]] std::size_t threads_of(std::size_t boxes) const {
    return boxes < fewest_for_threads ? 1 : threads_;
  }

  template <std::size_t axes>
  void find(Tiles<axes>& all, std::span<const Aabb> boxes, std::span<const Filter> filters) {
    const std::size_t threads = threads_of(boxes.size());
    const bool is_stale = boxes.size() != sorted_slots_ || axes != sorted_axes_ ||
                          static_cast<double>(work_) > stale * static_cast<double>(fresh_work_);
    if (is_stale) sort<axes>(boxes, filters, threads);
    fill(all, boxes, filters, threads);
    search_all(all, filters, threads);
    if (is_stale) fresh_work_ = work_;
  }

  template <std::size_t axes>
  void sort(std::span<const Aabb> boxes, std::span<const Filter> filters, std::size_t threads);
  template <std::size_t axes>
  void fill(Tiles<axes>& all, std::span<const Aabb> boxes, std::span<const Filter> filters,
            std::size_t threads);
  template <std::size_t axes>
  void sweep(Tiles<axes>& all);
  template <std::size_t axes>
  void search_all(const Tiles<axes>& all, std::span<const Filter> filters, std::size_t threads);

  std::size_t threads_;
  std::vector<std::uint32_t> order_;  // slots by tile; no_slot where a tile has no more
  std::size_t sorted_slots_ = 0;
  std::size_t sorted_axes_ = 0;
  std::size_t work_ = 0;        // of the last search
  std::size_t fresh_work_ = 0;  // of the first one in this order
  Tiles<3> three_;
  Tiles<4> four_;
  std::vector<std::pair<float, std::uint32_t>> swept_;
  std::vector<Found> found_;  // by each thread
  PairSort sort_pairs_;
};

/// Puts the slots into an order in which neighbours in space mostly share a tile.
template <std::size_t axes>
void SweepAndPrune::sort(std::span<const Aabb> boxes, std::span<const Filter> filters, std::size_t threads) {
  sorted_slots_ = 0;
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
    if (axes > 3 && filters[slot].world == Filter::all_worlds) size = size_classes - 1;
    if (is_empty(box)) size = size_classes;
    classes.at(size).push_back(centre_of(bounds_of<axes>(box, filters, slot), slot));
  }
  order_.clear();
  for (std::vector<Centre<axes>>& centres : classes) {
    if (&centres != &classes.back()) split(std::span(centres), threads);
    for (const Centre<axes>& centre : centres) order_.push_back(centre.slot);
    while (order_.size() % node_size != 0) order_.push_back(no_slot);
  }
  sorted_slots_ = boxes.size();
  sorted_axes_ = axes;
}

/// Copies the boxes to their tiles.
template <std::size_t axes>
void SweepAndPrune::fill(Tiles<axes>& all, std::span<const Aabb> boxes, std::span<const Filter> filters,
                         std::size_t threads) {
  const std::size_t tiles = order_.size() / node_size;
  all.tiles.resize(tiles);
  all.bounds.resize(tiles);
  constexpr std::size_t at_once = 64;
  parallel_for((tiles + at_once - 1) / at_once, threads, [&](std::size_t part, std::size_t /*thread*/) {
    for (std::size_t tile = part * at_once; tile < std::min(tiles, (part + 1) * at_once); ++tile) {
      Bounds<axes> bounds = make_bounds<axes>(infinity, -infinity);
      for (std::size_t k = 0; k < node_size; ++k) {
        const std::uint32_t slot = order_[tile * node_size + k];
        const Bounds<axes> box =
            slot == no_slot ? make_bounds<axes>(nan, nan) : bounds_of<axes>(boxes[slot], filters, slot);
        all.tiles[tile].set(k, box, slot);
        extend(bounds, box);
      }
      all.bounds[tile] = bounds;
    }
  });
  sweep(all);
}

/// The axis along which a tile overlaps the fewest others, as some of them tell.
template <std::size_t axes>
std::size_t best_axis(std::span<const Bounds<axes>> tiles) {
  constexpr std::size_t samples = 16;
  std::array<std::size_t, axes> overlaps{};
  for (std::size_t s = 0; s < tiles.size(); s += tiles.size() / samples + 1) {
    for (std::size_t axis = 0; axis < axes; ++axis) {
      const float lower = tiles[s].lower[axis];
      const float upper = tiles[s].upper[axis];
      for (const Bounds<axes>& tile : tiles) {
        overlaps[axis] += static_cast<unsigned>(lower <= tile.upper[axis]) &
                          static_cast<unsigned>(tile.lower[axis] <= upper);
      }
    }
  }
  return static_cast<std::size_t>(std::ranges::min_element(overlaps) - overlaps.begin());
}

/// Puts the tiles into the order of the sweep.
template <std::size_t axes>
void SweepAndPrune::sweep(Tiles<axes>& all) {
  all.axis = best_axis<axes>(all.bounds);
  swept_.clear();
  for (std::uint32_t tile = 0; tile < all.bounds.size(); ++tile) {
    const Bounds<axes>& bounds = all.bounds[tile];
    if (bounds.lower[all.axis] <= bounds.upper[all.axis]) swept_.emplace_back(bounds.lower[all.axis], tile);
  }
  std::ranges::sort(swept_);
  all.nodes.clear();
  for (std::size_t k = 0; k < swept_.size(); ++k) {
    if (k % node_size == 0) {
      all.nodes.emplace_back();
      for (std::size_t child = 0; child < node_size; ++child)
        all.nodes.back().set(child, make_bounds<axes>(nan, nan), no_slot);
    }
    all.nodes.back().set(k % node_size, all.bounds[swept_[k].second], swept_[k].second);
  }
}

template <std::size_t axes>
void SweepAndPrune::search_all(const Tiles<axes>& all, std::span<const Filter> filters, std::size_t threads) {
  static const SearchRange<axes> search_range = best_search<axes>();
  found_.resize(std::max(found_.size(), threads));
  for (Found& found : found_) found.count = found.work = 0;
  const std::size_t tiles = swept_.size();
  parallel_for((tiles + tiles_at_once - 1) / tiles_at_once, threads,
               [&](std::size_t part, std::size_t thread) {
                 search_range(found_[thread], all, part * tiles_at_once,
                              std::min(tiles, (part + 1) * tiles_at_once), filters);
               });
  work_ = 0;
  for (const Found& found : found_) work_ += found.work;
}

}  // namespace

std::unique_ptr<Algorithm> make_sweep_and_prune(const Config& config) {
  return make_host_engine(SweepAndPrune(config.threads));
}

}  // namespace broadcl
