#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "algorithms/algorithm.hpp"
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
/// Frames after which the order is taken to be old where its work is not known.
constexpr std::size_t unwatched = 8;

using opencl::divide_up;
using opencl::round_up;

/// Boxes in an order of space, under a tree of bounds: kernels/tiles.cl.
class Tiles final : public PairFinder {
 public:
  Tiles(const opencl::Context& context, double stale)
      : context_(context),
        stale_(stale),
        group_(context.shape() == opencl::Shape::cpu ? 1 : node),
        sort_(context) {
    const cl::Program program = context.program("tiles.cl", "-DGROUP=" + std::to_string(group_));
    opencl::translate_errors(context.device().label(), [&] {
      extent_kernel_ = cl::Kernel(program, "tiles_extent");
      keys_ = cl::Kernel(program, "tiles_keys");
      fill_ = cl::Kernel(program, "tiles_fill");
      raise_ = cl::Kernel(program, "tiles_raise");
      search_ = cl::Kernel(program, "tiles_search");
      extent_ = context.buffer(6 * sizeof(cl_uint));
    });
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (search.slots < 2 || (!search.all && search.changed_count == 0)) return;
    reserve(search.slots);
    if (is_stale(search, sink)) sort(search, sink, profiler);
    build(search, profiler);
    enqueue_search(search, sink, profiler);
  }

 private:
  void reserve(std::size_t slots) {
    if (slots <= capacity_) return;
    capacity_ = 0;
    sorted_slots_ = 0;
    const std::size_t capacity = round_up(slots + slots / 2, node);
    elements_ = context_.buffer(capacity * sizeof(cl_ulong));
    scratch_ = context_.buffer(capacity * sizeof(cl_ulong));
    std::size_t nodes = 0;
    for (std::size_t level = 0, size = capacity; level < levels; ++level) {
      starts_.s[level] = static_cast<cl_uint>(nodes);
      size = divide_up(size, node);
      nodes += size;
    }
    tree_ = context_.buffer(nodes * node_bytes);
    capacity_ = capacity;
  }

  /// Whether the order is of other slots, or has made the last frame's work grow. The first frame in a new
  /// order that is followed by another one here says how much work there is to be. Only tiles count work:
  /// where there was none, another finder was asked, and the order's age must do.
  bool is_stale(const Search& search, const PairDelta& sink) {
    if (search.slots != sorted_slots_) return true;
    if (sink.frames() == sorted_frame_) return false;
    if (sink.work() == 0) return sink.frames() - sorted_frame_ > unwatched;
    if (fresh_work_ == 0) fresh_work_ = sink.work();
    return static_cast<double>(sink.work()) > stale_ * static_cast<double>(fresh_work_);
  }

  void sort(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) {
    const opencl::Profiler::Scope stage(profiler, "sort");
    sorted_slots_ = 0;  // until all of it is enqueued: half a sort may have a slot twice
    const cl::CommandQueue& queue = context_.queue();
    constexpr std::size_t bytes = 3 * sizeof(cl_uint);
    queue.enqueueFillBuffer(extent_, ~cl_uint{0}, 0, bytes);
    queue.enqueueFillBuffer(extent_, cl_uint{0}, bytes, bytes);
    const std::size_t useful = std::size_t{context_.device().compute_units} * 8;
    const std::size_t groups =
        std::max(divide_up(search.slots, group * 4096), std::min(divide_up(search.slots, group), useful));
    opencl::set_arguments(extent_kernel_, 0, search.slots, search.boxes, extent_);
    queue.enqueueNDRangeKernel(extent_kernel_, cl::NullRange, cl::NDRange(groups * group),
                               cl::NDRange(group));
    opencl::set_arguments(keys_, 0, search.slots, search.boxes, extent_, elements_);
    queue.enqueueNDRangeKernel(keys_, cl::NullRange, cl::NDRange(round_up(search.slots, group)),
                               cl::NDRange(group));
    sort_.enqueue(elements_, scratch_, search.slots, std::array{opencl::RadixSort::Bits{32, code_bits}});
    sorted_slots_ = search.slots;
    sorted_frame_ = sink.frames();
    fresh_work_ = 0;
  }

  /// Puts boxes and bounds into the tree.
  void build(const Search& search, opencl::Profiler& profiler) {
    opencl::Profiler::Scope stage(profiler, "build");
    std::size_t nodes = divide_up(search.slots, node);
    opencl::set_arguments(fill_, 0, search.slots, static_cast<cl_uint>(nodes), starts_.s[1], search.boxes,
                          elements_, tree_);
    enqueue(fill_, round_up(nodes, node), stage.event());
    for (std::size_t level = 1; level + 1 < levels; ++level) {
      nodes = divide_up(nodes, node);
      opencl::set_arguments(raise_, 0, starts_.s[level], static_cast<cl_uint>(nodes), starts_.s[level + 1],
                            tree_);
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
    cl_uint k = opencl::set_arguments(search_, 0, starts_, roots_, share, tree_, elements_,
                                      search.any_filters ? cl_uint{1} : cl_uint{0}, search.filters);
    sink.set_sink(search_, k);
    context_.queue().enqueueNDRangeKernel(search_, cl::NullRange, cl::NDRange(tiles * group_, sharers),
                                          cl::NDRange(group_, 1), nullptr, stage.event());
  }

  /// Work-groups that share the search of a tile: where there are few tiles, a GPU has too little to do else.
  [[nodiscard]] std::size_t sharers(std::size_t tiles) const {
    if (group_ == 1) return 1;
    const std::size_t useful = std::size_t{context_.device().compute_units} * groups_per_unit;
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
  opencl::RadixSort sort_;
  cl::Kernel extent_kernel_, keys_, fill_, raise_, search_;
  cl::Buffer extent_;
  cl::Buffer elements_, scratch_;  // slots in order
  cl::Buffer tree_;
  cl_uint4 starts_{};         // the first nodes of its levels
  std::size_t capacity_ = 0;  // slots
  cl_uint roots_ = 0;
  std::size_t sorted_slots_ = 0;
  std::size_t sorted_frame_ = 0;
  std::size_t fresh_work_ = 0;  // of the first frame known in this order; 0 before it is
};

}  // namespace

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context) {
  return make_tiles(context, default_stale);
}

std::unique_ptr<PairFinder> make_tiles(const opencl::Context& context, double stale) {
  return std::make_unique<Tiles>(context, stale);
}

}  // namespace broadcl
