#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "algorithms/algorithm.hpp"
#include "algorithms/centroids.hpp"
#include "algorithms/near_pairs.hpp"
#include "algorithms/pair_finder.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/radix_sort.hpp"

namespace broadcl {
namespace {

/// Launch parameters.
struct TilesLaunch {
  std::size_t node;   ///< Children of a node, as in kernels/tiles.h for this group.
  std::size_t group;  ///< Work-items per work-group: one per child, as many as a GPU runs in step; or one.
  std::size_t most_roots;  ///< Of the search: a launch more would leave fewer.
};

constexpr TilesLaunch tiles_on_gpus{.node = 32, .group = 32, .most_roots = 8};
constexpr TilesLaunch tiles_on_gpus_of_64{.node = 64, .group = 64, .most_roots = 8};
constexpr TilesLaunch tiles_on_cpus{.node = 32, .group = 1, .most_roots = 1};

TilesLaunch launch_for(opencl::Tuning tuning) {
  if (tuning == opencl::Tuning::cpu) return tiles_on_cpus;
  return tuning == opencl::Tuning::gpu64 ? tiles_on_gpus_of_64 : tiles_on_gpus;
}

// The values of kernels/tiles.h.
/// The bounds of a child, and its worlds if there are any.
constexpr std::size_t child_bytes = sizeof(Aabb);
constexpr std::size_t child_bytes_of_worlds = child_bytes + 2 * sizeof(cl_uint);
constexpr unsigned code_bits = 31;
/// The highest of them, by which boxes are sorted: one radix pass less than for all, and trees as good.
constexpr unsigned sorted_bits = 24;
constexpr std::size_t levels = 4;  // as many as a cl_uint4 has numbers
constexpr std::size_t reported_work = 256;

constexpr std::size_t most_sharers = 8;
constexpr std::size_t search_groups_per_unit = 64;         // as far as most_sharers allows
constexpr std::size_t dense_search_groups_per_unit = 128;  // if all tiles are dense
constexpr double default_stale = 1.25;
/// How often, on average, each box may move before the order counts as old, if its work is not known.
constexpr std::size_t unwatched = 8;
/// At least 1 / fewest_moved of the boxes must have moved before the order may be old.
constexpr std::size_t fewest_moved = 64;
/// From this many boxes on, a GPU takes long enough to receive them that a search meanwhile pays.
constexpr std::size_t fewest_searched_early = 1 << 17;

/// Kinds of searches, whose work is compared separately: of the boxes that changed, of all boxes, and of all
/// boxes as they were in the last frame.
enum Kind : std::size_t { some_changed, all_changed, early };
/// The work of these searches, if the boxes have one size, as a multiple of usual_work().
constexpr std::array default_factors{0.9, 0.25, 0.25};
/// An early search takes more time than it saves if its work is more than this multiple of that of a search
/// of all.
constexpr double most_early_work = 2;

/// A search is given up, and the boxes are sorted, if it takes more work than this many searches of all boxes
/// in a new order, which is far more than is_stale() allows. If all boxes leapt, the work would be n^2.
constexpr double hopeless = 4;

/// Up to this many objects are gathered in the order of the tiles, which saves a launch; with more, gathering
/// them in their own order takes less time.
constexpr std::size_t most_gathered = 131072;

/// Whether worlds or sets are a fourth dimension, so that tiles have objects of one world or set.
bool has_worlds(const Search& search) {
  return search.worlds || search.sets;
}

/// The parameter `sets` of kernels/filter.h.
cl_uint sets(const Search& search) {
  return search.sets ? 1 : 0;
}

/// Whether two numbers are so close that an observation for one also holds for the other.
bool alike(std::size_t s, std::size_t t) {
  return 2 * s <= 3 * t && 2 * t <= 3 * s;
}

using opencl::divide_up;
using opencl::round_up;

/// Boxes in spatial order, under a tree of bounds: kernels/tiles.cl.
class Tiles final : public PairFinder {
 public:
  Tiles(const opencl::Context& context, double stale, std::size_t fewest_early)
      : context_(context),
        stale_(stale),
        launch_(launch_for(context.tuning())),
        centroids_(context),
        near_(context, fewest_early),
        sort_(context) {
    load({}, false);
  }

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    is_built_ = search.now.slots > 1 && search.changed_slots() > 0;
    if (!is_built_) return PairFinder::build(search, sink, profiler);
    const bool may_gather = search.source != nullptr && search.now.slots <= most_gathered;
    load(search, may_gather);
    prepare(search);
    observe(sink);
    age(search, sink);
    const bool stale = is_stale(search, sink);
    usual_work_ = usual_work(search);
    const bool is_early =
        near_.begin(search, sink, !stale, factors_[early] <= most_early_work * factors_[all_changed]);
    kind_ = is_early ? early : search.all ? all_changed : some_changed;
    if (is_early) return search_early(search, sink, profiler);
    const bool gathers = may_gather && !stale;
    if (!gathers) PairFinder::build(search, sink, profiler);
    if (stale) sort(search, sink, profiler);
    fill_trees(search, gathers, sink, profiler);
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (!is_built_) return;
    if (kind_ != early) enqueue_search(search, sink, profiler);
    near_.test(search, sink, profiler);
  }

  [[nodiscard]] bool gave_up(const PairDelta::Counts& counts) override {
    if (!is_built_) return false;
    const bool is_hopeless = counts.work > most_work_;
    return near_.missed(counts, is_hopeless) || is_hopeless;
  }

  void rebuild(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (kind_ == early) {
      near_.give_up();
      kind_ = all_changed;
    } else {
      sort(search, sink, profiler);
    }
    fill_trees(search, false, sink, profiler);
  }

  /// (The order may come from boxes of an incomplete frame.)
  void forget() noexcept override { sorted_slots_ = 0; }

  /// Nodes and boxes to visit, in proportion to those of the last search of this kind. If the scene has
  /// changed much since then, or there was no such search, the number for boxes of one size.
  [[nodiscard]] double expected_work(const Search& search, const PairDelta& sink) override {
    observe(sink);
    const bool is_known = alike(seen_.slots, search.now.slots) && alike(seen_.pairs, sink.pair_count());
    return usual_work(search) *
           (is_known ? factors_ : default_factors).at(search.all ? all_changed : some_changed);
  }

 private:
  struct Kernels {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    opencl::SizedKernel centroids, keys, world_keys;
    cl::Kernel fill, raise, search;
    cl::Kernel search_some{};  // if it is built
  };

  /// Builds the kernels that a search needs, whether it sorts or not, unless they are built. If the device
  /// runs one of them only in smaller work-groups, changes to the launch parameters for CPUs for good.
  /// @param may_gather Whether the search may be of objects that are still to be gathered.
  void load(const Search& search, bool may_gather) {
    try {
      const bool worlds = has_worlds(search);
      (void)kernels(worlds);
      if (!search.all) (void)search_kernel(false, worlds);
      if (may_gather) (void)gathering_fill(worlds);  // in the first frame, although that sorts
    } catch (const opencl::GroupTooLarge&) {
      launch_ = tiles_on_cpus;
      kernels_ = {};
      gathering_fills_ = {};
      capacity_ = 0;  // nodes may have had another size
      load(search, may_gather);
    }
  }

  /// The kernels for one world or for several.
  Kernels& kernels(bool worlds) {
    Kernels& kernels = kernels_.at(worlds ? 1 : 0);
    if (kernels.search() != nullptr) return kernels;
    const cl::Program program = context_.program("tiles.cl", options(worlds));
    kernels = {.centroids = context_.sized_kernel(program, "centroids"),
               .keys = context_.sized_kernel(program, "tiles_keys"),
               .world_keys = context_.sized_kernel(program, "tiles_world_keys"),
               .fill = context_.kernel(program, "tiles_fill", launch_.group),
               .raise = context_.kernel(program, "tiles_raise", launch_.group),
               .search = context_.kernel(program, "tiles_search", launch_.group)};
    return kernels;
  }

  Kernels& kernels(const Search& search) { return kernels(has_worlds(search)); }

  /// The kernel that searches all boxes or those that changed.
  cl::Kernel& search_kernel(bool all, bool worlds) {
    if (all) return kernels(worlds).search;
    cl::Kernel& search = kernels(worlds).search_some;
    if (search() == nullptr) {
      search = context_.kernel(context_.program("tiles_search.cl", options(worlds) + " -DSOME_CHANGED=1"),
                               "tiles_search", launch_.group);
    }
    return search;
  }

  /// The kernel that gathers all boxes and fills the tree with them.
  cl::Kernel& gathering_fill(bool worlds) {
    cl::Kernel& fill = gathering_fills_.at(worlds ? 1 : 0);
    if (fill() == nullptr) {
      fill = context_.kernel(context_.program("tiles_build.cl", options(worlds) + " -DGATHER=1"),
                             "tiles_fill", launch_.group);
    }
    return fill;
  }

  [[nodiscard]] std::string options(bool worlds) const {
    return "-DGROUP=" + std::to_string(launch_.group) + (context_.has_nvidia_vote() ? " -DNVIDIA" : "") +
           (worlds ? " -DWORLDS=1" : "");
  }

  struct Tree {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer nodes;
    std::size_t bytes = 0;
  };

  void prepare(const Search& search) {
    if (search.now.slots > capacity_) reserve(search.now.slots);
    reserve_tree(tree_, has_worlds(search));
    if (!search.all) reserve_tree(changed_tree_, has_worlds(search));
  }

  void reserve(std::size_t slots) {
    capacity_ = 0;
    sorted_slots_ = 0;
    elements_ = scratch_ = {};
    tree_ = changed_tree_ = {};
    const std::size_t needed = round_up(slots, launch_.node);
    std::size_t capacity = opencl::grown(context_, needed * sizeof(cl_ulong), "order of boxes") /
                           sizeof(cl_ulong) / launch_.node * launch_.node;
    set_levels(capacity);
    if (tree_bytes(true) > context_.device().max_allocation) {
      capacity = needed;
      set_levels(capacity);
    }
    elements_ = context_.buffer(capacity * sizeof(cl_ulong));
    scratch_ = context_.buffer(capacity * sizeof(cl_ulong));
    capacity_ = capacity;
  }

  /// Sets the number of nodes of a tree for this many boxes, and the first of each level.
  void set_levels(std::size_t capacity) {
    nodes_ = 0;
    for (std::size_t level = 0, size = capacity; level < levels; ++level) {
      starts_.s[level] = static_cast<cl_uint>(nodes_);
      size = divide_up(size, launch_.node);
      nodes_ += size;
    }
  }

  [[nodiscard]] std::size_t tree_bytes(bool worlds) const {
    return nodes_ * launch_.node * (worlds ? child_bytes_of_worlds : child_bytes);
  }

  void reserve_tree(Tree& tree, bool worlds) const {
    const std::size_t bytes = tree_bytes(worlds);
    if (tree.bytes >= bytes) return;
    tree = {};
    opencl::refuse_too_large(context_, bytes, "tree of boxes", context_.device().max_allocation);
    tree = {.nodes = context_.buffer(bytes), .bytes = bytes};
  }

  /// Records the work of the last search of these tiles.
  void observe(const PairDelta& sink) {
    if (!searched_frame_ || sink.frames() != *searched_frame_ + 1 || sink.work() == 0) return;
    seen_ = {.pairs = sink.pair_count(), .slots = sorted_slots_};
    factors_.at(kind_) = static_cast<double>(sink.work()) / usual_work_;
  }

  /// Records that a search begins.
  void age(const Search& search, const PairDelta& sink) {
    // Another finder did the frames in between; all boxes may have moved in them.
    if (searched_frame_) moved_ += (sink.frames() - *searched_frame_ - 1) * std::size_t{search.now.slots};
    moved_ += search.changed_slots();
    searched_frame_ = sink.frames();
  }

  /// Whether the order is for another number of slots, or so old that the last frame's work has grown. That
  /// work is compared with the first frame in this order that was followed by another one here, separately
  /// for searches of all boxes and of some. If another finder did the last frame, the number of boxes that
  /// moved decides.
  bool is_stale(const Search& search, const PairDelta& sink) {
    if (search.now.slots != sorted_slots_ || search.worlds != sorted_by_world_ ||
        search.sets != sorted_by_set_)
      return true;
    if (sink.frames() == sorted_frame_) return false;
    if (sink.work() == 0) return moved_ > unwatched * search.now.slots;
    double& fresh = fresh_factors_.at(kind_);
    if (fresh == 0) fresh = factors_.at(kind_);
    // The work for a few boxes says little, so wait until some have moved.
    const bool may_be_old =
        static_cast<double>(moved_ * fewest_moved) >= stale_ * static_cast<double>(search.now.slots);
    return factors_.at(kind_) > stale_ * fresh && may_be_old;
  }

  /// The work of a search in a new order, up to a factor: a constant per tile, and more per box that changed.
  [[nodiscard]] double usual_work(const Search& search) const {
    return usual_work(search.now.slots, search.changed_slots());
  }
  [[nodiscard]] double usual_work(std::size_t slots, std::size_t changed) const {
    return 4 * static_cast<double>(divide_up(slots, launch_.node)) + 12 * static_cast<double>(changed);
  }

  /// The work at which a search by this many work-groups is given up; the largest number if it must not be.
  [[nodiscard]] cl_uint most_work(const Search& search, const PairDelta& sink, std::size_t groups) const {
    constexpr cl_uint any = std::numeric_limits<cl_uint>::max();
    if (!search.may_give_up || sink.frames() == sorted_frame_) return any;
    const double factor =
        std::max({default_factors[all_changed], factors_[all_changed], fresh_factors_[all_changed]});
    const double most = hopeless * factor * usual_work(search.now.slots, search.now.slots);
    // Each work-group may do some more before it knows; the kernel counts in 32 bits.
    const bool overflows = most + 2.0 * reported_work * static_cast<double>(groups) >= any;
    return overflows ? any : static_cast<cl_uint>(most);
  }

  void sort(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    const opencl::Profiler::Scope stage(profiler, "sort");
    sorted_slots_ = 0;  // until all of it is enqueued: an incomplete sort may have a slot twice
    Kernels& kernels = this->kernels(search);
    const cl::Buffer& filters = has_worlds(search) ? search.now.filters : cl::Buffer();
    // (Sets of one world share their bounds.)
    centroids_.enqueue(this->kernels(search.worlds).centroids, search.now.boxes,
                       search.worlds ? filters : cl::Buffer(), search.now.slots);
    opencl::set_arguments(kernels.keys.kernel, 0, search.now.slots, search.now.boxes, filters,
                          centroids_.buckets(), centroids_.result(), elements_);
    kernels.keys.enqueue(context_.queue(), search.now.slots);
    sort_.enqueue(elements_, scratch_, search.now.slots, {{32 + code_bits - sorted_bits, sorted_bits}});
    if (has_worlds(search)) {  // they count first, so they are sorted by last
      opencl::set_arguments(kernels.world_keys.kernel, 0, search.now.slots, sets(search), filters, elements_);
      kernels.world_keys.enqueue(context_.queue(), search.now.slots);
      const unsigned bits = search.worlds ? 32 : 1;
      sort_.enqueue(elements_, scratch_, search.now.slots, {{32, bits}});
    }
    sorted_by_world_ = search.worlds;
    sorted_by_set_ = search.sets;
    sorted_slots_ = search.now.slots;
    sorted_frame_ = sink.frames();
    fresh_factors_ = {};
    moved_ = 0;
  }

  /// Fills the trees with boxes and bounds.
  void fill_trees(const Search& search, bool gathers, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "build");
    if (gathers) {
      cl::Kernel& fill = gathering_fill(has_worlds(search));
      search.source->set_arguments(fill, set_fill(fill, search, tree_), search.now, sink.counts());
      fill_tree(context_.queue(), search, fill, tree_, stage.event());
      return;
    }
    const auto fill = [&](const cl::Buffer& stamps, const Tree& tree, cl::Event* event) {
      fill_tree(context_.queue(), search, search.now.boxes, stamps, tree, event);
    };
    fill({}, tree_, stage.event());
    if (!search.all) fill(search.stamps, changed_tree_, nullptr);
  }

  void fill_tree(const cl::CommandQueue& queue, const Search& search, const cl::Buffer& boxes,
                 const cl::Buffer& stamps, const Tree& tree, cl::Event* event) {
    cl::Kernel& fill = kernels(search).fill;
    opencl::set_arguments(fill, set_fill(fill, search, tree), boxes,
                          has_worlds(search) ? search.now.filters : cl::Buffer(), search.stamp, stamps);
    fill_tree(queue, search, fill, tree, event);
  }

  cl_uint set_fill(cl::Kernel& fill, const Search& search, const Tree& tree) const {
    return opencl::set_arguments(fill, 0, search.now.slots,
                                 static_cast<cl_uint>(divide_up(search.now.slots, launch_.node)),
                                 starts_.s[1], sets(search), elements_, tree.nodes);
  }

  void fill_tree(const cl::CommandQueue& queue, const Search& search, const cl::Kernel& fill,
                 const Tree& tree, cl::Event* event) {
    std::size_t nodes = divide_up(search.now.slots, launch_.node);
    enqueue(queue, fill, round_up(nodes, launch_.node), event);
    nodes = divide_up(nodes, launch_.node);
    cl::Kernel& raise = kernels(search).raise;
    // The search starts at the first level that has few nodes.
    for (top_ = 1; nodes > launch_.most_roots && top_ + 1 < levels;
         ++top_, nodes = divide_up(nodes, launch_.node)) {
      opencl::set_arguments(raise, 0, starts_.s[top_], static_cast<cl_uint>(nodes), starts_.s[top_ + 1],
                            tree.nodes);
      enqueue(queue, raise, round_up(nodes, launch_.node), nullptr);
    }
    roots_ = static_cast<cl_uint>(nodes);
  }

  /// Enqueues the search for near pairs.
  void search_early(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    {
      opencl::Profiler::Scope stage(profiler, "build");
      fill_tree(near_.queue(), search, near_.boxes(), {}, tree_, stage.event());
    }
    enqueue_search(search, sink, profiler);
    near_.searched();
  }

  void enqueue_search(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, kind_ == early ? "early" : "test");
    const std::size_t tiles = divide_up(search.now.slots, launch_.node);
    const std::size_t sharers = this->sharers(tiles, search_groups_per_unit);
    // A first search finds all pairs at once; in later ones, work-groups that turn out to be too many would
    // take longer than the others save.
    const bool is_first = search.last.slots == 0;
    const std::size_t dense_sharers = is_first ? this->sharers(tiles, dense_search_groups_per_unit) : sharers;
    most_work_ = most_work(search, sink, tiles * dense_sharers);
    cl::Kernel& kernel = search_kernel(search.all, has_worlds(search));
    const cl_uint next = opencl::set_arguments(kernel, 0, starts_, static_cast<cl_uint>(top_), roots_,
                                               static_cast<cl_uint>(sharers), most_work_, sets(search),
                                               tree_.nodes, (search.all ? tree_ : changed_tree_).nodes,
                                               elements_, search.now.filters, search.now.exclusions);
    const bool is_early = kind_ == early;
    if (is_early) {
      near_.set_sink(kernel, next, search);
    } else {
      sink.set_sink(kernel, next, search);
    }
    const cl::CommandQueue& queue = is_early ? near_.queue() : context_.queue();
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(tiles * launch_.group, dense_sharers),
                               cl::NDRange(launch_.group, 1), nullptr, stage.event());
  }

  /// Number of work-groups that share the search of a tile; if there are few tiles, a GPU would otherwise
  /// have too little to do.
  [[nodiscard]] std::size_t sharers(std::size_t tiles, std::size_t groups_per_unit) const {
    if (launch_.group == 1) return 1;
    const std::size_t useful = context_.device().compute_units * groups_per_unit;
    std::size_t sharers = 1;
    while (sharers < most_sharers && tiles * sharers * 2 <= useful) sharers *= 2;
    return sharers;
  }

  void enqueue(const cl::CommandQueue& queue, const cl::Kernel& kernel, std::size_t groups,
               cl::Event* event) const {
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * launch_.group),
                               cl::NDRange(launch_.group), nullptr, event);
  }

  const opencl::Context& context_;
  double stale_;  // see make_tiles()
  TilesLaunch launch_;
  CentroidBounds centroids_;
  NearPairs near_;
  opencl::RadixSort sort_;
  std::array<Kernels, 2> kernels_;
  std::array<cl::Kernel, 2> gathering_fills_;
  cl::Buffer elements_, scratch_;  // slots in order
  Tree tree_;
  Tree changed_tree_;         // of boxes that changed, if not all did
  std::size_t nodes_ = 0;     // of a tree
  cl_uint4 starts_{};         // the first nodes of its levels
  std::size_t capacity_ = 0;  // slots
  std::size_t top_ = 1;       // the level at which the search starts
  cl_uint roots_ = 0;         // its nodes
  bool is_built_ = false;     // for this search
  std::size_t sorted_slots_ = 0;
  bool sorted_by_world_ = false;
  bool sorted_by_set_ = false;
  std::size_t sorted_frame_ = 0;
  std::optional<std::size_t> searched_frame_;
  std::size_t moved_ = 0;    // boxes since the order was new, each counted as often as it moved
  double usual_work_ = 1;    // of the last search
  cl_uint most_work_ = 0;    // at which it is given up
  Kind kind_ = all_changed;  // of that search
  // The work of searches of each kind, as a multiple of usual_work(): of the last ones, and of the first ones
  // in this order (0 if there was none).
  std::array<double, 3> factors_ = default_factors;
  std::array<double, 3> fresh_factors_{};
  struct {
    std::size_t pairs = 0;
    std::size_t slots = 0;
  } seen_;  // by the last search
};

}  // namespace

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context) {
  const Device& device = context.device();
  const bool uploads_beside = device.type == DeviceType::gpu && !device.host_unified;
  return make_tiles(context, default_stale,
                    uploads_beside ? fewest_searched_early : std::numeric_limits<std::size_t>::max());
}

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double stale,
                                       std::size_t fewest_early) {
  return std::make_unique<Tiles>(context, stale, fewest_early);
}

}  // namespace broadcl
