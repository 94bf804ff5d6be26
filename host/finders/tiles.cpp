#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "engines/algorithm.hpp"
#include "engines/kernel_arguments.hpp"
#include "engines/pair_finder.hpp"
#include "finders/centroids.hpp"
#include "finders/near_pairs.hpp"
#include "finders/tile_work.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/radix_sort.hpp"

namespace broadcl {
namespace {

constexpr std::size_t search_groups_per_unit = 32;         // as far as tiles_max_workers allows
constexpr std::size_t dense_search_groups_per_unit = 128;  // if all tiles are dense
/// From this many boxes on, a GPU takes long enough to receive them that a search meanwhile pays.
constexpr std::size_t fewest_searched_early = 1 << 17;

/// If more than one of so many tiles have grown to twice their size since the last frame, boxes have leapt,
/// and a search would be given up.
constexpr std::size_t least_share_grown = 8;

/// Up to this many objects are gathered tile by tile, which saves a launch; with more, gathering them by slot
/// takes less time.
constexpr std::size_t most_gathered = 131072;

/// Whether worlds or sets are a fourth dimension, so that tiles have objects of one world or set.
bool has_worlds(const Search& search) {
  return search.worlds || search.sets;
}

/// The parameter `worlds` of kernels/tiles_build.cl.
cl_uint worlds(const Search& search) {
  return has_worlds(search) ? 1 : 0;
}

/// The parameter `sets` of kernels/filter.h.
cl_uint sets(const Search& search) {
  return search.sets ? 1 : 0;
}

using opencl::divide_up;
using opencl::round_up;

/// Boxes sorted in space, under a tree of bounds: kernels/tiles.cl.
class Tiles final : public PairFinder {
 public:
  Tiles(const opencl::Context& context, double sort_work, std::size_t fewest_early)
      : context_(context),
        group_(context.launch().tiles_group),
        kernels_(make_kernels()),
        work_(node_, sort_work),
        centroids_(context),
        near_(context, kernels_.program, fewest_early),
        sort_(context) {}

  void begin(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    is_built_ = search.now.slots > 1 && search.changed_slots() > 0;
    is_early_ = false;
    if (!is_built_) return;
    prepare(search);
    is_stale_ = work_.begin_frame(search, sink);
    const bool follows = filled_ && filled_->frame + 1 == sink.frames() && search.same_filters &&
                         !search.changed.all && filled_->stamp < search.changed.stamp;
    since_ = follows ? filled_->stamp : 0;
    filled_.reset();
    is_early_ = near_.begin(search, sink, !is_stale_, work_.early_pays(), profiler);
    work_.begin_search(search, is_early_);
    if (is_early_) search_early(search, sink, profiler);
  }

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (!is_built_) return PairFinder::build(search, sink, profiler);
    // (Not later: keeping pairs at the same time takes longer than afterwards.)
    if (is_early_) return near_.await_search();
    const bool gathers = search.source != nullptr && search.now.slots <= most_gathered && !is_stale_;
    if (!gathers) PairFinder::build(search, sink, profiler);
    if (is_stale_) sort(search, sink, profiler);
    fill_trees(search, gathers, sink, profiler);
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (!is_built_) return;
    if (!is_early_) {
      refit(search, sink, profiler);
      enqueue_search(search, sink, profiler);
    }
    near_.test(search, sink, profiler);
  }

  [[nodiscard]] bool keeps(const Search& search, const PairDelta& /*sink*/) const override {
    return is_built_ && !is_early_ && group_ > 1 && nodes_of(search) > context_.launch().tiles_max_roots;
  }

  [[nodiscard]] bool gave_up(const PairDelta::Counts& counts) override {
    if (!is_built_) return false;
    const bool was_given_up = counts.work > most_work_ || counts.grown_tiles > most_grown_;
    return near_.missed(counts, was_given_up) || was_given_up;
  }

  void rebuild(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (is_early_) {
      near_.pause();
      is_early_ = false;
      work_.begin_search(search, is_early_);
    } else {
      work_.give_up(sink);
      sort(search, sink, profiler);
    }
    fill_trees(search, false, sink, profiler);
  }

  /// (The boxes that were sorted may be those of an incomplete frame.)
  void forget() noexcept override { work_.forget_sort(); }

 private:
  struct Kernels {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Program program;
    opencl::SizedKernel centroids, keys, world_keys;
    cl::Kernel fill, refit;
    cl::Kernel refit_and_keep;      // on a GPU
    cl::Kernel search, search_all;  // any boxes; one world without reaches, all of whose boxes changed
  };

  [[nodiscard]] Kernels make_kernels() const {
    const std::string options =
        "-DGROUP=" + std::to_string(group_) + (context_.has_nvidia_vote() ? " -DNVIDIA" : "");
    const cl::Program program = context_.program("tiles.cl", options);
    const auto kernel = [&](const char* name) { return context_.kernel(program, name, group_); };
    Kernels kernels{.program = program,
                    .centroids = context_.sized_kernel(program, "centroids"),
                    .keys = context_.sized_kernel(program, "tiles_keys"),
                    .world_keys = context_.sized_kernel(program, "tiles_world_keys"),
                    .fill = kernel("tiles_fill"),
                    .refit = kernel("tiles_refit"),
                    .refit_and_keep = {},
                    .search = kernel("tiles_search"),
                    .search_all = kernel("tiles_search")};
    if (group_ > 1) {
      kernels.refit_and_keep = context_.kernel(program, "tiles_refit_and_keep", layout::TILES_KEEP_GROUP);
      kernels.search = context_.kernel(context_.program("tiles_search.cl", options + " -DGENERAL=1"),
                                       "tiles_search", group_);
    }
    return kernels;
  }

  /// When the trees were filled with boxes of which some had changed.
  struct Filled {
    std::size_t frame = 0;
    cl_uint stamp = 0;
  };

  struct Tree {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Buffer nodes;
    std::size_t bytes = 0;
  };

  void prepare(const Search& search) {
    if (search.now.slots > capacity_) reserve(search.now.slots);
    reserve_tree(tree_, has_worlds(search));
    if (!search.changed.all) reserve_tree(changed_tree_, has_worlds(search));
  }

  void reserve(std::size_t slots) {
    capacity_ = 0;
    work_.forget_sort();
    elements_ = scratch_ = {};
    tree_ = changed_tree_ = {};
    const std::size_t needed = round_up(slots, node_);
    std::size_t capacity =
        opencl::grown(context_, needed * sizeof(cl_ulong), "sorted boxes") / sizeof(cl_ulong) / node_ * node_;
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
    for (std::size_t level = 0, size = capacity; level < layout::TREE_LEVELS; ++level) {
      starts_.at(level) = static_cast<cl_uint>(nodes_);
      size = divide_up(size, node_);
      nodes_ += size;
    }
  }

  [[nodiscard]] std::size_t tree_bytes(bool worlds) const {
    return nodes_ * node_ * sizeof(cl_uint) * (worlds ? layout::CHILD_WORDS_OF_WORLDS : layout::CHILD_WORDS);
  }

  void reserve_tree(Tree& tree, bool worlds) const {
    const std::size_t bytes = tree_bytes(worlds);
    if (tree.bytes >= bytes) return;
    tree = {};
    opencl::refuse_too_large(context_, bytes, "tree of boxes", context_.device().max_allocation);
    tree = {.nodes = context_.buffer(bytes), .bytes = bytes};
  }

  void sort(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "sort");
    work_.forget_sort();  // until all is enqueued: after a part of it, a slot may be there twice
    since_ = 0;
    const cl::Buffer& filters = has_worlds(search) ? search.now.filters : cl::Buffer();
    // (Sets of one world share their bounds.)
    centroids_.enqueue(kernels_.centroids, search.now.boxes, search.worlds ? filters : cl::Buffer(),
                       search.now.slots, &stage);
    opencl::set_arguments(kernels_.keys.kernel, 0, search.now.slots, search.now.boxes, filters,
                          centroids_.buckets(), centroids_.result(), elements_);
    kernels_.keys.enqueue(context_.queue(), search.now.slots, stage.event());
    sort_.enqueue(elements_, scratch_, search.now.slots,
                  {{32 + layout::CODE_BITS - layout::SORTED_BITS, layout::SORTED_BITS}}, &stage);
    if (has_worlds(search)) {  // they count first, so they are sorted by last
      opencl::set_arguments(kernels_.world_keys.kernel, 0, search.now.slots, sets(search), filters,
                            elements_);
      kernels_.world_keys.enqueue(context_.queue(), search.now.slots, stage.event());
      const unsigned bits = search.worlds ? 32 : 1;
      sort_.enqueue(elements_, scratch_, search.now.slots, {{32, bits}}, &stage);
    }
    work_.set_sorted(search, sink);
  }

  /// Fills the trees with boxes and the bounds of tiles.
  void fill_trees(const Search& search, bool gathers, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "build");
    if (gathers) {
      search.source->set_arguments(kernels_.fill, set_fill(search), search.now, sink.counts());
      enqueue_fill(context_.queue(), search, stage.event());
      return;
    }
    fill_trees(context_.queue(), search, search.now.boxes, sink.counts(), stage.event());
    if (!search.changed.all) filled_ = {.frame = sink.frames(), .stamp = search.changed.stamp};
  }

  void fill_trees(const cl::CommandQueue& queue, const Search& search, const cl::Buffer& boxes,
                  const cl::Buffer& counts, cl::Event* event) {
    Source::set_no_arguments(kernels_.fill, set_fill(search), boxes,
                             has_worlds(search) ? search.now.filters : cl::Buffer(), counts);
    enqueue_fill(queue, search, event);
  }

  /// Sets all but the GATHER_PARAMETERS; returns the index of the first of these.
  cl_uint set_fill(const Search& search) {
    return opencl::set_arguments(kernels_.fill, 0, search.now.slots, static_cast<cl_uint>(tiles_of(search)),
                                 starts_.at(1), worlds(search), sets(search), elements_, tree_.nodes,
                                 changed_nodes(search), search.changed.stamp, since_, search.changed.stamps);
  }

  void enqueue_fill(const cl::CommandQueue& queue, const Search& search, cl::Event* event) {
    enqueue(queue, kernels_.fill, round_up(tiles_of(search), node_), search, event);
  }

  /// Null if all boxes changed.
  [[nodiscard]] cl::Buffer changed_nodes(const Search& search) const {
    return search.changed.all ? cl::Buffer() : changed_tree_.nodes;
  }

  [[nodiscard]] std::size_t tiles_of(const Search& search) const {
    return divide_up(search.now.slots, node_);
  }
  /// Nodes whose children are tiles.
  [[nodiscard]] std::size_t nodes_of(const Search& search) const {
    return divide_up(tiles_of(search), node_);
  }

  /// Computes the bounds of nodes, of one level after the other, and keeps the pairs of the last frame if
  /// that was left to this.
  void refit(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    const bool keeps = this->keeps(search, sink);
    if (keeps) {
      opencl::Profiler::Scope stage(profiler, "keep");
      const std::size_t nodes = nodes_of(search);
      sink.set_keep_kernel(kernels_.refit_and_keep, set_refit(kernels_.refit_and_keep, search, 1, nodes),
                           search);
      const std::size_t groups =
          round_up(nodes, node_) * trees_of(search) * group_ / layout::TILES_KEEP_GROUP +
          divide_up(sink.most_to_keep(), std::size_t{layout::TILES_KEEP_GROUP} * layout::TILES_KEEP_RUN);
      context_.queue().enqueueNDRangeKernel(kernels_.refit_and_keep, cl::NullRange,
                                            cl::NDRange(groups * layout::TILES_KEEP_GROUP),
                                            cl::NDRange(layout::TILES_KEEP_GROUP), nullptr, stage.event());
    }
    opencl::Profiler::Scope stage(profiler, "refit");
    refit(context_.queue(), search, keeps ? 2 : 1, stage);
  }

  /// @param level The first whose bounds are to be computed.
  void refit(const cl::CommandQueue& queue, const Search& search, std::size_t level,
             opencl::Profiler::Scope& stage) {
    std::size_t nodes = nodes_of(search);
    // The search starts at the first level that has at most `most_roots` nodes.
    for (top_ = 1; nodes > context_.launch().tiles_max_roots && top_ + 1 < layout::TREE_LEVELS;
         ++top_, nodes = divide_up(nodes, node_)) {
      if (top_ < level) continue;
      set_refit(kernels_.refit, search, top_, nodes);
      enqueue(queue, kernels_.refit, round_up(nodes, node_), search, stage.event());
    }
    roots_ = static_cast<cl_uint>(nodes);
  }

  /// @param nodes Of the level.
  cl_uint set_refit(cl::Kernel& kernel, const Search& search, std::size_t level, std::size_t nodes) const {
    return opencl::set_arguments(kernel, 0, starts_.at(level), static_cast<cl_uint>(nodes),
                                 starts_.at(level + 1), worlds(search), tree_.nodes, changed_nodes(search));
  }

  /// Enqueues the search for near pairs.
  void search_early(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    {
      opencl::Profiler::Scope stage(profiler, "build");
      fill_trees(near_.queue(), search, near_.boxes(), {}, stage.event());
    }
    {
      opencl::Profiler::Scope stage(profiler, "refit");
      refit(near_.queue(), search, 1, stage);
    }
    enqueue_search(search, sink, profiler);
    near_.searched();
  }

  void enqueue_search(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, is_early_ ? "early" : "test");
    const std::size_t tiles = tiles_of(search);
    const std::size_t workers = this->workers(tiles, search_groups_per_unit);
    // A first search finds all pairs at once; in later ones, work-groups that turn out to be too many would
    // take longer than the others save.
    const bool is_first = search.last.slots == 0;
    const std::size_t dense_workers = is_first ? this->workers(tiles, dense_search_groups_per_unit) : workers;
    most_work_ = work_.most(search, sink, tiles * dense_workers);
    const bool may_give_up = most_work_ < std::numeric_limits<cl_uint>::max();
    most_grown_ = may_give_up ? static_cast<cl_uint>(tiles / least_share_grown) : most_work_;
    const bool is_all = search.changed.all && !has_worlds(search) && search.now.ungrown() == nullptr &&
                        search.last.ungrown() == nullptr;
    cl::Kernel& kernel = is_all ? kernels_.search_all : kernels_.search;
    layout::tiles_search_scalars_t scalars{.starts = {},
                                           .top = static_cast<cl_uint>(top_),
                                           .roots = roots_,
                                           .workers = static_cast<cl_uint>(workers),
                                           .most_work = most_work_,
                                           .most_grown = most_grown_,
                                           .worlds = worlds(search),
                                           .sets = sets(search)};
    std::ranges::copy(starts_, scalars.starts);
    const cl_uint next = opencl::set_arguments(kernel, 0, scalars, tree_.nodes, changed_nodes(search),
                                               elements_, search.now.filters, search.now.exclusions);
    if (is_early_) {
      near_.set_sink(kernel, next, search);
    } else {
      sink.set_sink(kernel, next, search);
    }
    const cl::CommandQueue& queue = is_early_ ? near_.queue() : context_.queue();
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(tiles * group_, dense_workers),
                               cl::NDRange(group_, 1), nullptr, stage.event());
  }

  /// Number of work-groups that share the search of a tile; if there are few tiles, a GPU would otherwise
  /// have too little to do.
  [[nodiscard]] std::size_t workers(std::size_t tiles, std::size_t groups_per_unit) const {
    const std::size_t useful = context_.device().compute_units * groups_per_unit;
    std::size_t workers = 1;
    while (workers < context_.launch().tiles_max_workers && tiles * workers * 2 <= useful) workers *= 2;
    return workers;
  }

  /// Enqueues a kernel with as many work-groups for each tree.
  void enqueue(const cl::CommandQueue& queue, const cl::Kernel& kernel, std::size_t groups,
               const Search& search, cl::Event* event) const {
    queue.enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * group_, trees_of(search)),
                               cl::NDRange(group_, 1), nullptr, event);
  }

  static std::size_t trees_of(const Search& search) { return search.changed.all ? 1 : 2; }

  const opencl::Context& context_;
  std::size_t group_;                       // work-items per work-group
  std::size_t node_ = CHILDREN_OF(group_);  // children of a node
  Kernels kernels_;
  TileWork work_;
  CentroidBounds centroids_;
  NearPairs near_;
  opencl::RadixSort sort_;
  cl::Buffer elements_, scratch_;  // slots, sorted
  Tree tree_;
  Tree changed_tree_;                                  // of boxes that changed, if not all did
  std::size_t nodes_ = 0;                              // of a tree
  std::array<cl_uint, layout::TREE_LEVELS> starts_{};  // the first nodes of its levels
  std::size_t capacity_ = 0;                           // slots
  std::size_t top_ = 1;                                // the level at which the search starts
  cl_uint roots_ = 0;                                  // its nodes
  std::optional<Filled> filled_;
  cl_uint since_ = 0;       // of this search: boxes with older stamps are in the trees already
  bool is_built_ = false;   // for this search
  bool is_stale_ = false;   // whether this search must sort
  bool is_early_ = false;   // whether this search is early
  cl_uint most_work_ = 0;   // at which it is given up
  cl_uint most_grown_ = 0;  // tiles, with which it is not begun
};

}  // namespace

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context) {
  const Device& device = context.device();
  const bool uploads_beside = device.type == DeviceType::gpu && !device.host_unified;
  return make_tiles(context, TileWork::default_sort_work,
                    uploads_beside ? fewest_searched_early : std::numeric_limits<std::size_t>::max());
}

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double sort_work,
                                       std::size_t fewest_early) {
  return std::make_unique<Tiles>(context, sort_work, fewest_early);
}

}  // namespace broadcl
