#include <algorithm>
#include <string>

#include "algorithms/algorithm.hpp"
#include "algorithms/device_boxes.hpp"
#include "algorithms/pair_delta.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/profiler.hpp"

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

constexpr Cut gpu_cut{.width = 4, .group = 128, .at_once = 2, .min_rows = 32, .max_rows = 256, .items = 4096};
constexpr Cut cpu_cut{.width = 16, .group = 1, .at_once = 4, .min_rows = 256, .max_rows = 4096, .items = 256};

/// Every pair tested on the device, the hits in a list, the changes found there too.
class BruteForce final : public Algorithm {
 public:
  explicit BruteForce(const BroadPhase::Config& config)
      : context_(select_device(config.device), config.profile),
        profiler_(config.profile),
        cut_(context_.shape() == opencl::Shape::cpu ? cpu_cut : gpu_cut),
        delta_(context_, profiler_) {
    const auto program = context_.program("brute_force.cl", "-DWIDTH=" + std::to_string(cut_.width) +
                                                                " -DGROUP=" + std::to_string(cut_.group) +
                                                                " -DROWS=" + std::to_string(cut_.at_once));
    opencl::translate_errors(context_.device().label(),
                             [&] { kernel_ = cl::Kernel(program, "brute_force"); });
  }

  void reserve(std::size_t boxes) override { boxes_.reserve(context_, boxes); }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return boxes_.host(); }

  Delta update(std::size_t n, std::span<const std::uint32_t> renewed) override {
    profiler_.begin();
    return opencl::translate_errors(context_.device().label(), [&] {
      return delta_.update(n, renewed, [&] {
        if (n > 1) find(static_cast<cl_uint>(n));
      });
    });
  }

  [[nodiscard]] std::vector<Pair> pairs() const override {
    return opencl::translate_errors(context_.device().label(), [&] { return delta_.pairs(); });
  }

  [[nodiscard]] const Device* device() const noexcept override { return &context_.device(); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return profiler_.stages(); }

 private:
  void find(cl_uint n) {
    {
      opencl::Profiler::Scope stage(profiler_, "upload");
      boxes_.upload(n, stage.event());
    }
    opencl::Profiler::Scope stage(profiler_, "test");
    const std::size_t columns = (n + cut_.width - 1) / cut_.width;
    // Half of the rows of an average column come before its boxes.
    const std::size_t wanted_items = std::size_t{context_.device().compute_units} * cut_.items;
    const std::size_t rows =
        std::clamp<std::size_t>(columns * n / 2 / wanted_items, cut_.min_rows, cut_.max_rows);
    kernel_.setArg(0, n);
    kernel_.setArg(1, static_cast<cl_uint>(rows));
    kernel_.setArg(2, boxes_.device());
    delta_.set_sink(kernel_, 3);
    context_.queue().enqueueNDRangeKernel(
        kernel_, cl::NullRange,
        cl::NDRange((columns + cut_.group - 1) / cut_.group * cut_.group, (n + rows - 1) / rows),
        cl::NDRange(cut_.group, 1), nullptr, stage.event());
    boxes_.reclaim();
  }

  opencl::Context context_;
  opencl::Profiler profiler_;
  Cut cut_;
  PairDelta delta_;
  cl::Kernel kernel_;
  DeviceBoxes boxes_;
};

}  // namespace

std::unique_ptr<Algorithm> make_brute_force(const BroadPhase::Config& config) {
  return std::make_unique<BruteForce>(config);
}

}  // namespace broadcl
