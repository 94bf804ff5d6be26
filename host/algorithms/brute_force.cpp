#include <algorithm>
#include <array>
#include <memory>
#include <string>

#include "algorithms/algorithm.hpp"
#include "algorithms/pair_finder.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// How the kernel is cut.
struct Cut {
  unsigned width;     ///< Boxes a that a work-item holds in registers.
  unsigned group;     ///< Work-items a work-group.
  unsigned at_once;   ///< Rows that a work-item tests before it looks for hits.
  unsigned min_rows;  ///< Rows that a work-item goes through, at the least.
  unsigned max_rows;  ///< And at the most.
  unsigned items;     ///< Work-items wanted for each compute unit, as far as min_rows and max_rows allow.
};

constexpr Cut gpu_cut{.width = 4, .group = 128, .at_once = 2, .min_rows = 16, .max_rows = 256, .items = 2500};
constexpr Cut cpu_cut{.width = 16, .group = 1, .at_once = 4, .min_rows = 256, .max_rows = 4096, .items = 256};

/// Every pair tested on the device: kernels/brute_force.cl.
class BruteForce final : public PairFinder {
 public:
  explicit BruteForce(const opencl::Context& context)
      : context_(context),
        cut_(context.shape() == opencl::Shape::cpu ? cpu_cut : gpu_cut),
        grain_(context.grain().value_or(1)) {
    (void)kernel(false);
  }

  void set_grain(double grain) override { grain_ = grain; }

  [[nodiscard]] std::size_t pieces(const Search& search) const override {
    return opencl::divide_up(rows_of(search), rows_a_piece(search));
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    const cl_uint n = search.slots;
    const cl_uint row_count = rows_of(search);
    if (n < 2 || row_count == 0) return;
    cl::Kernel& kernel = this->kernel(search.worlds);
    opencl::Profiler::Scope stage(profiler, "test");
    const std::size_t columns = opencl::divide_up(n, cut_.width);
    const std::size_t rows = rows_a_piece(search);
    cl_uint k =
        opencl::set_arguments(kernel, 0, n, row_count, static_cast<cl_uint>(rows), search.boxes,
                              search.changed, search.any_filters ? cl_uint{1} : cl_uint{0}, search.filters);
    sink.set_sink(kernel, k);
    context_.queue().enqueueNDRangeKernel(
        kernel, cl::NullRange,
        cl::NDRange(opencl::round_up(columns, cut_.group), opencl::divide_up(row_count, rows)),
        cl::NDRange(cut_.group, 1), nullptr, stage.event());
  }

 private:
  static cl_uint rows_of(const Search& search) { return search.all ? search.slots : search.changed_count; }

  /// Rows that a work-item goes through.
  [[nodiscard]] std::size_t rows_a_piece(const Search& search) const {
    // Half of the rows of an average column come before its boxes.
    const std::size_t columns = opencl::divide_up(search.slots, cut_.width);
    const std::size_t runs = columns * rows_of(search) / (search.all ? 2 : 1);
    const double items = static_cast<double>(context_.device().compute_units) * cut_.items / grain_;
    return static_cast<std::size_t>(
        std::clamp<double>(static_cast<double>(runs) / items, cut_.min_rows, cut_.max_rows));
  }

  /// The kernel for one world or for several, built when it is first needed.
  cl::Kernel& kernel(bool worlds) {
    cl::Kernel& kernel = kernels_[worlds ? 1 : 0];
    if (kernel() == nullptr) {
      const std::string options =
          "-DWIDTH=" + std::to_string(cut_.width) + " -DGROUP=" + std::to_string(cut_.group) +
          " -DROWS=" + std::to_string(cut_.at_once) + " -DMAX_ROWS=" + std::to_string(cut_.max_rows) +
          (worlds ? " -DWORLDS=1" : "");
      const cl::Program program = context_.program("brute_force.cl", options);
      opencl::translate_errors(context_.device().label(),
                               [&] { kernel = cl::Kernel(program, "brute_force"); });
    }
    return kernel;
  }

  const opencl::Context& context_;
  Cut cut_;
  double grain_;
  std::array<cl::Kernel, 2> kernels_;
};

}  // namespace

std::unique_ptr<PairFinder> make_brute_force(const opencl::Context& context) {
  return std::make_unique<BruteForce>(context);
}

}  // namespace broadcl
