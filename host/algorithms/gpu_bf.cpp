#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "algorithms/algorithm.hpp"
#include "algorithms/byte_matrix.hpp"
#include "algorithms/device_objects.hpp"
#include "algorithms/triangle.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {
namespace {

/// How the kernel is cut.
struct Cut {
  unsigned width;       ///< Pairs that a work-item packs into one store.
  unsigned group_size;  ///< Work-items a work-group.
  unsigned min_rows;    ///< Rows that a work-item goes through, at the least.
  unsigned max_rows;    ///< And at the most.
  unsigned items;       ///< Work-items wanted for each compute unit, as far as min_rows and max_rows allow.
};

constexpr Cut gpu_cut{.width = 4, .group_size = 128, .min_rows = 8, .max_rows = 128, .items = 4096};
constexpr Cut cpu_cut{.width = 16, .group_size = 64, .min_rows = 64, .max_rows = 512, .items = 1024};

using opencl::divide_up;
using opencl::round_up;

/// The paper's algorithm: one byte of result a pair. The bytes of this frame and of the last one stay on the
/// host, which XORs them.
class GpuBf final : public Algorithm {
 public:
  explicit GpuBf(const BroadPhase::Config& config)
      : context_(select_device(config.device), config.profile),
        profiler_(config.profile),
        cut_(context_.shape() == opencl::Shape::cpu ? cpu_cut : gpu_cut),
        objects_(context_, profiler_) {
    const auto program = context_.program("gpu_bf.cl", "-DWIDTH=" + std::to_string(cut_.width));
    opencl::translate_errors(context_.device().label(), [&] { kernel_ = cl::Kernel(program, "gpu_bf"); });
  }

  void reserve(std::size_t boxes) override { objects_.reserve(boxes); }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return objects_.boxes(); }

  /// Tests all pairs, whatever changed, and brings the results to the host.
  void begin(const Changes& changes) override {
    profiler_.begin();
    renewed_ = changes.renewed;
    current_pairs_ = triangle::row_start(static_cast<std::uint32_t>(changes.slots));
    opencl::translate_errors(context_.device().label(), [&] {
      grow_results(changes.slots, current_pairs_);
      if (current_pairs_ > 0) test(changes);
    });
  }

  void flush() override {
    opencl::translate_errors(context_.device().label(), [&] { context_.queue().flush(); });
  }

  Delta finish() override {
    if (current_pairs_ > 0) wait();
    {
      const opencl::Profiler::Scope stage(profiler_, "xor");
      find_changes(bytes_of(previous_, previous_pairs_), bytes_of(current_, current_pairs_), renewed_, added_,
                   removed_);
    }
    std::swap(previous_, current_);
    previous_pairs_ = current_pairs_;
    return {added_, removed_};
  }

  [[nodiscard]] std::vector<Pair> pairs() const override {
    std::vector<Pair> found;
    std::vector<Pair> none;
    find_changes({}, bytes_of(previous_, previous_pairs_), {}, found, none);
    return found;
  }

  [[nodiscard]] const Device* device() const noexcept override { return &context_.device(); }
  [[nodiscard]] MemoryUse memory() const noexcept override { return context_.memory(); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return profiler_.stages(); }

 private:
  [[nodiscard]] static std::span<const std::byte> bytes_of(const opencl::SharedBuffer& results,
                                                           std::size_t pairs) {
    return {results.host(), pairs};
  }

  /// Makes room for the results of this frame; those of the last one are kept, since their index does not
  /// depend on n.
  void grow_results(std::size_t n, std::size_t pairs) {
    const std::size_t bytes = round_up(pairs, cut_.width);
    if (bytes <= current_.bytes()) return;
    const std::uint64_t limit = context_.device().max_allocation;
    if (bytes > limit) {
      throw Error(context_.device().label() + ": gpu-bf needs a buffer of " + std::to_string(bytes) +
                  " bytes for " + std::to_string(n) + " boxes, one byte a pair, but the device allocates " +
                  std::to_string(limit) + " at most; use another algorithm, or a device with more memory");
    }
    const std::size_t wanted = std::min<std::uint64_t>(limit, round_up(bytes + bytes / 2, cut_.width));
    opencl::SharedBuffer current(context_, wanted);
    opencl::SharedBuffer previous(context_, wanted);
    if (previous_pairs_ > 0) std::memcpy(previous.host(), previous_.host(), previous_pairs_);
    current_ = std::move(current);
    previous_ = std::move(previous);
  }

  void test(const Changes& changes) {
    try {
      Changes all = changes;
      all.all = true;
      all.filters_changed = true;  // perhaps in an update that had no pairs to test
      all.renewed = {};            // the host looks at them
      const Search search = objects_.upload(all);
      {
        opencl::Profiler::Scope stage(profiler_, "test");
        current_.lend();
        enqueue_kernel(search, stage.event());
      }
      opencl::Profiler::Scope stage(profiler_, "download");
      current_.download(current_pairs_, &read_);
      if (stage.event() != nullptr) *stage.event() = read_;
    } catch (...) {
      give_up();
      throw;
    }
  }

  void give_up() noexcept { opencl::wait_after_failure(context_.queue()); }

  void wait() {
    opencl::translate_errors(context_.device().label(), [&] {
      try {
        {
          opencl::Profiler::Scope stage(profiler_, "wait");
          read_.wait();
        }
        profiler_.resolve();
        objects_.commit();
      } catch (...) {
        give_up();
        throw;
      }
    });
  }

  void enqueue_kernel(const Search& search, cl::Event* event) {
    const cl_uint n = search.slots;
    const unsigned period = 2 * cut_.width;
    const std::size_t columns = round_up(divide_up(n, cut_.width), cut_.group_size);
    const std::size_t class_rows = (n + period - 1) / period;
    // Half of the columns of an average row are past its end.
    const std::size_t wanted_items = std::size_t{context_.device().compute_units} * cut_.items;
    const std::size_t rows = std::clamp<std::size_t>(columns / 2 * period * class_rows / wanted_items,
                                                     cut_.min_rows, cut_.max_rows);
    const std::size_t chunks = (class_rows + rows - 1) / rows;
    const std::size_t seam_lines = (n + columns - 1) / columns;
    opencl::set_arguments(kernel_, 0, n, static_cast<cl_uint>(rows), static_cast<cl_uint>(chunks),
                          search.boxes, search.any_filters ? cl_uint{1} : cl_uint{0}, search.filters,
                          current_.device());
    context_.queue().enqueueNDRangeKernel(kernel_, cl::NullRange,
                                          cl::NDRange(columns, period * chunks + seam_lines),
                                          cl::NDRange(cut_.group_size, 1), nullptr, event);
  }

  opencl::Context context_;
  opencl::Profiler profiler_;
  Cut cut_;
  cl::Kernel kernel_;
  DeviceObjects objects_;
  opencl::SharedBuffer current_;   // bytes of this frame while it runs
  opencl::SharedBuffer previous_;  // bytes of the last frame
  cl::Event read_;                 // when the bytes of this frame are the host's
  std::size_t current_pairs_ = 0;
  std::size_t previous_pairs_ = 0;
  std::span<const std::uint32_t> renewed_;
  std::vector<Pair> added_;
  std::vector<Pair> removed_;
};

}  // namespace

std::unique_ptr<Algorithm> make_gpu_bf(const BroadPhase::Config& config) {
  return std::make_unique<GpuBf>(config);
}

}  // namespace broadcl
