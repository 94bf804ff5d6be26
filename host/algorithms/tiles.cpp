#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "algorithms/algorithm.hpp"
#include "algorithms/centroids.hpp"
#include "algorithms/pair_finder.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/radix_sort.hpp"

namespace broadcl {
namespace {

// As kernels/tiles.cl has them.
constexpr std::size_t node = 32;
constexpr std::size_t node_bytes = node * sizeof(Aabb);
constexpr unsigned code_bits = 31;
constexpr std::size_t levels = 4;  // as many as a cl_uint4 has numbers

constexpr std::size_t group = 64;  // of kernels that do a box per work-item
constexpr std::size_t most_sharers = 8;
constexpr std::size_t groups_per_unit = 64;  // of the search, as far as sharers can make so many
constexpr double default_stale = 1.25;
/// How often all boxes may move before the order is taken to be old if its work is not known.
constexpr std::size_t unwatched = 8;
/// At least one box in so many must have moved before the order may be old.
constexpr std::size_t fewest_moved = 64;
/// What searches of some and of all need of boxes of one size, as a multiple of usual_work().
constexpr std::array default_factors{0.9, 0.25};

/// Whether two numbers are so alike that what was seen of the one holds for the other.
bool alike(std::size_t s, std::size_t t) {
  return 2 * s <= 3 * t && 2 * t <= 3 * s;
}

using opencl::divide_up;
using opencl::round_up;

/// Boxes in an order of space, under a tree of bounds: kernels/tiles.cl.
class Tiles final : public PairFinder {
 public:
  Tiles(const opencl::Context& context, double stale)
      : context_(context),
        stale_(stale),
        group_(context.tuning() == opencl::Tuning::cpu ? 1 : node),
        centroids_(context),
        sort_(context) {
    const cl::Program program = this->program(true);
    keys_ = cl::Kernel(program, "tiles_keys");
    raise_ = cl::Kernel(program, "tiles_raise");
    of_all_ = kernels_of(program);
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (search.now.slots < 2 || search.changed_slots() == 0) return;
    prepare(search);
    observe(sink);
    age(search, sink);
    if (is_stale(search, sink)) sort(search, sink, profiler);
    build(search, profiler);
    enqueue_search(search, sink, profiler);
    usual_work_ = usual_work(search);
    usual_is_of_all_ = search.all;
  }

  /// Nodes and boxes to visit: as many as in the last search of the kind, in proportion. If the scene is
  /// another one since, or there was none, as many as among boxes of one size.
  [[nodiscard]] double expected_work(const Search& search, const PairDelta& sink) override {
    observe(sink);
    const bool is_known = alike(seen_.slots, search.now.slots) && alike(seen_.pairs, sink.pair_count());
    return usual_work(search) * (is_known ? factors_ : default_factors).at(search.all ? 1 : 0);
  }

 private:
  /// Kernels that differ if not all boxes changed.
  struct Kernels {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl::Kernel fill, search;
  };

  [[nodiscard]] cl::Program program(bool all) const {
    return context_.program("tiles.cl",
                            "-DGROUP=" + std::to_string(group_) + (all ? "" : " -DSOME_CHANGED=1"));
  }

  static Kernels kernels_of(const cl::Program& program) {
    return {cl::Kernel(program, "tiles_fill"), cl::Kernel(program, "tiles_search")};
  }

  void prepare(const Search& search) {
    if (search.now.slots > capacity_) reserve(search.now.slots);
    if (search.all) return;
    if (changed_tree_() == nullptr) changed_tree_ = context_.buffer(nodes_ * node_bytes);
    if (of_some_.search() == nullptr) of_some_ = kernels_of(program(false));
  }

  void reserve(std::size_t slots) {
    capacity_ = 0;
    sorted_slots_ = 0;
    elements_ = scratch_ = tree_ = changed_tree_ = {};
    const std::size_t bytes =
        opencl::grown(context_, round_up(slots, node) * sizeof(cl_ulong), "order of boxes");
    const std::size_t capacity = bytes / sizeof(cl_ulong) / node * node;
    elements_ = context_.buffer(bytes);
    scratch_ = context_.buffer(bytes);
    nodes_ = 0;
    for (std::size_t level = 0, size = capacity; level < levels; ++level) {
      starts_.s[level] = static_cast<cl_uint>(nodes_);
      size = divide_up(size, node);
      nodes_ += size;
    }
    tree_ = context_.buffer(nodes_ * node_bytes);
    capacity_ = capacity;
  }

  /// Takes note of what the last search of these tiles needed.
  void observe(const PairDelta& sink) {
    if (!searched_frame_ || sink.frames() != *searched_frame_ + 1) return;
    seen_ = {.pairs = sink.pair_count(), .slots = sorted_slots_};
    factors_.at(usual_is_of_all_ ? 1 : 0) = static_cast<double>(sink.work()) / usual_work_;
  }

  /// Takes note of a search that begins.
  void age(const Search& search, const PairDelta& sink) {
    if (searched_frame_ == sink.frames()) return;  // once more
    // Another finder did the frames between; all boxes may have moved in them.
    if (searched_frame_) moved_ += (sink.frames() - *searched_frame_ - 1) * std::size_t{search.now.slots};
    moved_ += search.changed_slots();
    searched_frame_ = sink.frames();
  }

  /// Whether the order is of other slots, or has made the last frame's work grow. The first frame in a new
  /// order that is followed by another one here says how much work there is to be, for searches of all and
  /// for those of some. If another finder did that frame, it must do how many boxes moved.
  bool is_stale(const Search& search, const PairDelta& sink) {
    if (search.now.slots != sorted_slots_) return true;
    if (sink.frames() == sorted_frame_) return false;
    if (sink.work() == 0) return moved_ > unwatched * search.now.slots;
    const std::size_t kind = usual_is_of_all_ ? 1 : 0;
    double& fresh = fresh_factors_.at(kind);
    if (fresh == 0) fresh = factors_.at(kind);
    // How much few boxes need says little: not before some have moved.
    const bool may_be_old =
        static_cast<double>(moved_ * fewest_moved) >= stale_ * static_cast<double>(search.now.slots);
    return factors_.at(kind) > stale_ * fresh && may_be_old;
  }

  /// What a search needs while the order is new, but for a factor: something for each tile, more for each box
  /// that changed.
  static double usual_work(const Search& search) {
    return 4 * static_cast<double>(divide_up(search.now.slots, node)) + 12 * search.changed_slots();
  }

  void sort(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    const opencl::Profiler::Scope stage(profiler, "sort");
    sorted_slots_ = 0;  // until all of it is enqueued: half a sort may have a slot twice
    centroids_.enqueue(search.now.boxes, search.now.slots);
    opencl::set_arguments(keys_, 0, search.now.slots, search.now.boxes, centroids_.result(), elements_);
    context_.queue().enqueueNDRangeKernel(keys_, cl::NullRange,
                                          cl::NDRange(round_up(search.now.slots, group)), cl::NDRange(group));
    sort_.enqueue(elements_, scratch_, search.now.slots, std::array{opencl::RadixSort::Bits{32, code_bits}});
    sorted_slots_ = search.now.slots;
    sorted_frame_ = sink.frames();
    fresh_factors_ = {};
    moved_ = 0;
  }

  /// Puts boxes and bounds into the trees.
  void build(const Search& search, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "build");
    build(search, of_all_.fill, tree_, stage.event());
    if (!search.all) build(search, of_some_.fill, changed_tree_, nullptr);
  }

  void build(const Search& search, cl::Kernel& fill, const cl::Buffer& tree, cl::Event* event) {
    std::size_t nodes = divide_up(search.now.slots, node);
    opencl::set_arguments(fill, 0, search.now.slots, static_cast<cl_uint>(nodes), starts_.s[1],
                          search.now.boxes, elements_, search.stamp, search.stamps, tree);
    enqueue(fill, round_up(nodes, node), event);
    for (std::size_t level = 1; level + 1 < levels; ++level) {
      nodes = divide_up(nodes, node);
      opencl::set_arguments(raise_, 0, starts_.s[level], static_cast<cl_uint>(nodes), starts_.s[level + 1],
                            tree);
      enqueue(raise_, round_up(nodes, node), nullptr);
    }
    roots_ = static_cast<cl_uint>(divide_up(nodes, node));
  }

  void enqueue_search(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "test");
    const std::size_t tiles = divide_up(search.now.slots, node);
    const std::size_t sharers = this->sharers(tiles);
    cl_uint share = 0;
    for (std::size_t k = 0; k < node; k += sharers) share |= cl_uint{1} << k;
    cl::Kernel& kernel = search.all ? of_all_.search : of_some_.search;
    const cl_uint first =
        opencl::set_arguments(kernel, 0, starts_, roots_, share, tree_, search.all ? tree_ : changed_tree_,
                              elements_, search.now.filters);
    sink.set_sink(kernel, first, search);
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(tiles * group_, sharers),
                                          cl::NDRange(group_, 1), nullptr, stage.event());
  }

  /// Work-groups that share the search of a tile: if there are few tiles, a GPU has too little to do
  /// otherwise.
  [[nodiscard]] std::size_t sharers(std::size_t tiles) const {
    if (group_ == 1) return 1;
    const std::size_t useful = context_.device().compute_units * groups_per_unit;
    std::size_t sharers = 1;
    while (sharers < most_sharers && tiles * sharers * 2 <= useful) sharers *= 2;
    return sharers;
  }

  void enqueue(const cl::Kernel& kernel, std::size_t groups, cl::Event* event) {
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * group_),
                                          cl::NDRange(group_), nullptr, event);
  }

  const opencl::Context& context_;
  double stale_;  // see make_tiles()
  std::size_t group_;
  CentroidBounds centroids_;
  opencl::RadixSort sort_;
  cl::Kernel keys_, raise_;
  Kernels of_all_;
  Kernels of_some_;                // made when first needed
  cl::Buffer elements_, scratch_;  // slots in order
  cl::Buffer tree_;
  cl::Buffer changed_tree_;   // of boxes that changed, if not all did
  std::size_t nodes_ = 0;     // of a tree
  cl_uint4 starts_{};         // the first nodes of its levels
  std::size_t capacity_ = 0;  // slots
  cl_uint roots_ = 0;
  std::size_t sorted_slots_ = 0;
  std::size_t sorted_frame_ = 0;
  std::optional<std::size_t> searched_frame_;
  std::size_t moved_ = 0;  // boxes since the order was new, each as often as it did
  double usual_work_ = 1;  // of the last search
  bool usual_is_of_all_ = true;
  // What searches needed as a multiple of usual_work(), of some and of all: the last ones, and the first ones
  // in this order; 0 before there was one.
  std::array<double, 2> factors_ = default_factors;
  std::array<double, 2> fresh_factors_{};
  struct {
    std::size_t pairs = 0;
    std::size_t slots = 0;
  } seen_;  // by the last search
};

}  // namespace

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context) {
  return make_tiles(context, default_stale);
}

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double stale) {
  return std::make_unique<Tiles>(context, stale);
}

}  // namespace broadcl
