#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>

#include "engines/algorithm.hpp"
#include "engines/kernel_arguments.hpp"
#include "engines/pair_finder.hpp"
#include "finders/row_launch.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// Up to this many pairs are kept by the same kernel, which takes less time than another launch.
constexpr std::size_t most_kept = 1 << 16;

/// Tests every pair on the device: kernels/brute_force.cl.
class BruteForce final : public PairFinder {
 public:
  explicit BruteForce(const opencl::Context& context)
      : context_(context), launch_(context.launch().brute_force) {
    // Rows that a work-item tests before it looks for hits.
    const unsigned rows_at_once = launch_.group == 1 ? 4 : 8;
    const std::string options =
        "-DWIDTH=" + std::to_string(launch_.width) + " -DGROUP=" + std::to_string(launch_.group) +
        " -DROWS=" + std::to_string(rows_at_once) + " -DMAX_ROWS=" + std::to_string(launch_.max_rows);
    kernel_ = context_.kernel(context_.program("brute_force.cl", options), "brute_force", launch_.group);
  }

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    // (Longer lists are kept by a kernel of their own, which comes first and needs the boxes.)
    gathers_ = search.source != nullptr && search.source->packed_boxes()() != nullptr && keeps(search, sink);
    if (!gathers_) PairFinder::build(search, sink, profiler);
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    if (!has_work(search)) return;
    const cl_uint n = search.now.slots;
    const cl_uint row_count = search.changed_slots();
    const cl::Buffer boxes = gathers_ ? search.source->packed_boxes() : search.now.boxes;
    const std::size_t columns = opencl::round_up(opencl::divide_up(n, launch_.width), launch_.group);
    const std::size_t rows = this->rows(search);
    const std::size_t runs = opencl::divide_up(row_count, rows);
    const std::size_t at_once = runs_at_once(launch_, rows, n);
    for (std::size_t first = 0; first < runs; first += at_once) {
      opencl::Profiler::Scope stage(profiler, "test");
      const cl_uint next = opencl::set_arguments(
          kernel_, 0,
          layout::brute_force_scalars_t{.n = n,
                                        .row_count = row_count,
                                        .rows = static_cast<cl_uint>(rows),
                                        .first_run = static_cast<cl_uint>(first)},
          boxes, search.changed.slots, search.changed.stamps, search.now.filters, search.now.exclusions,
          gathers_ && first == 0 ? search.now.boxes : cl::Buffer());
      sink.set_sink(kernel_, sink.set_keep(kernel_, next, search, first == 0 && keeps(search, sink)), search);
      context_.queue().enqueueNDRangeKernel(kernel_, cl::NullRange,
                                            cl::NDRange(columns, std::min(at_once, runs - first)),
                                            cl::NDRange(launch_.group, 1), nullptr, stage.event());
    }
    // If this search is repeated, later commands may have overwritten the caller's boxes; the copy is
    // complete.
    gathers_ = false;
  }

  [[nodiscard]] bool keeps(const Search& search, const PairDelta& sink) const override {
    return launch_.group > 1 && has_work(search) && sink.pair_count() <= most_kept;
  }

 private:
  [[nodiscard]] static bool has_work(const Search& search) {
    return search.now.slots > 1 && search.changed_slots() > 0;
  }

  /// Rows per work-item.
  [[nodiscard]] std::size_t rows(const Search& search) const {
    // In an average column, half of the rows come before its boxes.
    const std::size_t columns = opencl::divide_up(search.now.slots, launch_.width);
    const std::size_t runs = columns * search.changed_slots() / (search.changed.all ? 2 : 1);
    return rows_per_item(launch_, runs, context_);
  }

  const opencl::Context& context_;
  const opencl::RowLaunch& launch_;
  cl::Kernel kernel_;
  bool gathers_ = false;  // this search: the kernel reads the caller's boxes, and copies them
};

}  // namespace

std::unique_ptr<PairFinder> make_brute_force(const opencl::Context& context) {
  return std::make_unique<BruteForce>(context);
}

}  // namespace broadcl
