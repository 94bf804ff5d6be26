#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "algorithms/algorithm.hpp"
#include "algorithms/extent.hpp"
#include "algorithms/pair_finder.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/radix_sort.hpp"

namespace broadcl {
namespace {

// As kernels/tiles.cl has them.
constexpr std::size_t node = 32;
constexpr std::size_t node_bytes = node * sizeof(Aabb);
constexpr unsigned code_bits = 31;
constexpr std::size_t levels = 4;  // as many as a cl_uint4 has numbers

constexpr std::size_t group = 64;  // of kernels that do a box a work-item
constexpr std::size_t most_sharers = 8;
constexpr std::size_t groups_per_unit = 64;  // of the search, as far as sharers can make so many
constexpr double default_stale = 1.25;
/// How often all boxes may move before the order is taken to be old where its work is not known.
constexpr std::size_t unwatched = 8;
/// One of so many boxes must have moved before the order may be old.
constexpr std::size_t fewest_moved = 64;

using opencl::divide_up;
using opencl::round_up;

/// Boxes in an order of space, under a tree of bounds: kernels/tiles.cl.
class Tiles final : public PairFinder {
 public:
  Tiles(const opencl::Context& context, double stale)
      : context_(context),
        stale_(stale),
        group_(context.shape() == opencl::Shape::cpu ? 1 : node),
        grain_(context.grain().value_or(1)),
        extent_(context),
        sort_(context) {
    opencl::translate_errors(context.device().label(), [&] {
      const cl::Program program = this->program(true);
      keys_ = cl::Kernel(program, "tiles_keys");
      raise_ = cl::Kernel(program, "tiles_raise");
      of_all_ = kernels_of(program);
    });
  }

  void set_grain(double grain) override { grain_ = grain; }

  [[nodiscard]] std::size_t pieces(const Search& search) const override {
    return sharers(divide_up(search.slots, node));
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (search.slots < 2 || (!search.all && search.changed_count == 0)) return;
    prepare(search);
    age(search, sink);
    if (is_stale(search, sink)) sort(search, sink, profiler);
    build(search, profiler);
    enqueue_search(search, sink, profiler);
    expect_work(search);
  }

 private:
  /// Kernels that differ where not all boxes changed.
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
    if (search.slots > capacity_) reserve(search.slots);
    if (search.all) return;
    if (changed_tree_() == nullptr) changed_tree_ = context_.buffer(nodes_ * node_bytes);
    if (of_some_.search() == nullptr) of_some_ = kernels_of(program(false));
  }

  void reserve(std::size_t slots) {
    capacity_ = 0;
    sorted_slots_ = 0;
    elements_ = scratch_ = tree_ = changed_tree_ = {};
    const std::size_t capacity = round_up(slots + slots / 2, node);
    elements_ = context_.buffer(capacity * sizeof(cl_ulong));
    scratch_ = context_.buffer(capacity * sizeof(cl_ulong));
    nodes_ = 0;
    for (std::size_t level = 0, size = capacity; level < levels; ++level) {
      starts_.s[level] = static_cast<cl_uint>(nodes_);
      size = divide_up(size, node);
      nodes_ += size;
    }
    tree_ = context_.buffer(nodes_ * node_bytes);
    capacity_ = capacity;
  }

  /// Takes note of a search that begins.
  void age(const Search& search, const PairDelta& sink) {
    if (sink.frames() == searched_frame_) return;  // once more
    // Another finder did the frames between; it may have been one in which all moved.
    moved_ += (sink.frames() - searched_frame_ - 1) * std::size_t{search.slots};
    moved_ += changed_of(search);
    searched_frame_ = sink.frames();
  }

  static std::size_t changed_of(const Search& search) {
    return search.all ? search.slots : search.changed_count;
  }

  /// Whether the order is of other slots, or has made the last frame's work grow. The first frame in a new
  /// order that is followed by another one here says how much work there is to be, for searches of all and
  /// for those of some. Where another finder was asked, there is none to go by, and it must do how many
  /// boxes moved.
  bool is_stale(const Search& search, const PairDelta& sink) {
    if (search.slots != sorted_slots_) return true;
    if (sink.frames() == sorted_frame_) return false;
    if (sink.work() == 0) return moved_ > unwatched * search.slots;
    const double work = static_cast<double>(sink.work()) / usual_work_;
    double& fresh = fresh_work_.at(usual_is_of_all_ ? 1 : 0);
    if (fresh == 0) fresh = work;
    // How much few boxes need says little: not before some have moved.
    const bool may_be_old =
        static_cast<double>(moved_ * fewest_moved) >= stale_ * static_cast<double>(search.slots);
    return work > stale_ * fresh && may_be_old;
  }

  /// What the work of this search is to be compared with in the next frame.
  void expect_work(const Search& search) {
    usual_work_ =
        4 * static_cast<double>(divide_up(search.slots, node)) + 12 * static_cast<double>(changed_of(search));
    usual_is_of_all_ = search.all;
  }

  void sort(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    const opencl::Profiler::Scope stage(profiler, "sort");
    sorted_slots_ = 0;  // until all of it is enqueued: half a sort may have a slot twice
    extent_.enqueue(search.boxes, search.slots);
    opencl::set_arguments(keys_, 0, search.slots, search.boxes, extent_.result(), elements_);
    context_.queue().enqueueNDRangeKernel(keys_, cl::NullRange, cl::NDRange(round_up(search.slots, group)),
                                          cl::NDRange(group));
    sort_.enqueue(elements_, scratch_, search.slots, std::array{opencl::RadixSort::Bits{32, code_bits}});
    sorted_slots_ = search.slots;
    sorted_frame_ = sink.frames();
    fresh_work_ = {};
    moved_ = 0;
  }

  /// Puts boxes and bounds into the trees.
  void build(const Search& search, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "build");
    build(search, of_all_.fill, tree_, stage.event());
    if (!search.all) build(search, of_some_.fill, changed_tree_, nullptr);
  }

  void build(const Search& search, cl::Kernel& fill, const cl::Buffer& tree, cl::Event* event) {
    std::size_t nodes = divide_up(search.slots, node);
    opencl::set_arguments(fill, 0, search.slots, static_cast<cl_uint>(nodes), starts_.s[1], search.boxes,
                          elements_, search.stamps.stamp, search.stamps.words, tree);
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
    const std::size_t tiles = divide_up(search.slots, node);
    const std::size_t sharers = this->sharers(tiles);
    cl_uint share = 0;
    for (std::size_t k = 0; k < node; k += sharers) share |= cl_uint{1} << k;
    cl::Kernel& kernel = search.all ? of_all_.search : of_some_.search;
    const cl_uint first =
        opencl::set_arguments(kernel, 0, starts_, roots_, share, tree_, search.all ? tree_ : changed_tree_,
                              elements_, search.any_filters ? cl_uint{1} : cl_uint{0}, search.filters);
    sink.set_sink(kernel, first);
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(tiles * group_, sharers),
                                          cl::NDRange(group_, 1), nullptr, stage.event());
  }

  /// Work-groups that share the search of a tile: where there are few tiles, a GPU has too little to do else.
  [[nodiscard]] std::size_t sharers(std::size_t tiles) const {
    if (group_ == 1) return 1;
    const double useful = static_cast<double>(context_.device().compute_units) * groups_per_unit / grain_;
    std::size_t sharers = 1;
    while (sharers < most_sharers && static_cast<double>(tiles * sharers * 2) <= useful) sharers *= 2;
    return sharers;
  }

  void enqueue(const cl::Kernel& kernel, std::size_t groups, cl::Event* event) {
    context_.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(groups * group_),
                                          cl::NDRange(group_), nullptr, event);
  }

  const opencl::Context& context_;
  double stale_;  // see make_tiles()
  std::size_t group_;
  double grain_;
  Extent extent_;
  opencl::RadixSort sort_;
  cl::Kernel keys_, raise_;
  Kernels of_all_;
  Kernels of_some_;                // made when first needed
  cl::Buffer elements_, scratch_;  // slots in order
  cl::Buffer tree_;
  cl::Buffer changed_tree_;   // of boxes that changed, where not all did
  std::size_t nodes_ = 0;     // of a tree
  cl_uint4 starts_{};         // the first nodes of its levels
  std::size_t capacity_ = 0;  // slots
  cl_uint roots_ = 0;
  std::size_t sorted_slots_ = 0;
  std::size_t sorted_frame_ = 0;
  std::size_t searched_frame_ = 0;
  std::size_t moved_ = 0;  // boxes since the order was new, each as often as it did
  // What a search is thought to need, where the order is new, but for a factor: something for each tile, more
  // for each box that changed.
  double usual_work_ = 1;
  bool usual_is_of_all_ = true;
  std::array<double, 2>
      fresh_work_{};  // that factor as first seen in this order, of some and of all; 0 before it is
};

}  // namespace

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context) {
  return make_tiles(context, default_stale);
}

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double stale) {
  return std::make_unique<Tiles>(context, stale);
}

}  // namespace broadcl
