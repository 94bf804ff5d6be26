#include <algorithm>
#include <string>
#include <utility>

#include "algorithms/algorithm.hpp"
#include "algorithms/byte_matrix.hpp"
#include "algorithms/change_lists.hpp"
#include "algorithms/device_objects.hpp"
#include "algorithms/row_launch.hpp"
#include "algorithms/triangle.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {
namespace {

constexpr RowLaunch gpu_bf_on_gpus{.width = 4,
                                   .group = 128,
                                   .min_rows = 8,
                                   .max_rows = 128,
                                   .items = 4096,
                                   .most_tests = std::size_t{1} << 32};
constexpr RowLaunch gpu_bf_on_cpus{.width = 16,
                                   .group = 64,
                                   .min_rows = 64,
                                   .max_rows = 512,
                                   .items = 1024,
                                   .most_tests = std::size_t{1} << 30};

using opencl::divide_up;
using opencl::round_up;

/// The paper's algorithm: one byte of result per pair. The host has the bytes of this frame and of the last
/// one, and XORs them.
class GpuBf final : public Algorithm {
 public:
  GpuBf(const Config& config, const Device& device)
      : context_(device, config.profile, config.on_compile),
        profiler_(config.profile),
        launch_(context_.tuning() == opencl::Tuning::cpu ? gpu_bf_on_cpus : gpu_bf_on_gpus),
        kernel_(make_kernel("gpu_bf")),
        exclude_(make_kernel("gpu_bf_exclude")),
        objects_(context_, profiler_) {}

  void reserve(std::size_t slots, bool filters) override {
    context_.guard([&] { objects_.reserve(slots, filters); });
  }

  void reserve_exclusions(std::size_t count) override {
    context_.guard([&] { objects_.reserve_exclusions(count); });
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return objects_.boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return objects_.boxes_owner(); }

  /// Tests all pairs, regardless of what changed, and copies the results to the host.
  void begin(const Changes& changes) override {
    profiler_.begin();
    recycled_.assign(changes.recycled.begin(), changes.recycled.end());
    current_pairs_ = triangle::row_start(static_cast<std::uint32_t>(changes.slots));
    context_.guard([&] {
      grow_results(changes.slots, current_pairs_);
      if (current_pairs_ > 0) test(changes);
    });
  }

  void flush() override {
    context_.guard([&] { context_.queue().flush(); });
  }

  Delta finish() override {
    if (current_pairs_ > 0) {
      context_.guard([&] {
        wait();
        profiler_.resolve();
      });
    }
    auto& [added, removed] = lists_.next();
    {
      const opencl::Profiler::Scope stage(profiler_, "xor");
      find_changes(bytes_of(previous_, previous_pairs_), bytes_of(current_, current_pairs_), recycled_, added,
                   removed);
    }
    if (current_pairs_ > 0) objects_.commit();
    std::swap(previous_, current_);
    previous_pairs_ = current_pairs_;
    lists_.commit();
    return {added, removed};
  }

  [[nodiscard]] std::shared_ptr<const void> delta_owner() const override { return lists_.owner(); }

  [[nodiscard]] std::vector<Pair> pairs() override {
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

  [[nodiscard]] opencl::SizedKernel make_kernel(const char* name, const std::string& option = {}) const {
    const std::string width = "-DWIDTH=" + std::to_string(launch_.width);
    return context_.sized_kernel(context_.program("gpu_bf.cl", width + option), name, launch_.group);
  }

  /// Grows the buffer of this frame's results. Those of the last frame are not changed.
  void grow_results(std::size_t n, std::size_t pairs) {
    const std::size_t bytes = round_up(pairs, launch_.width);
    if (bytes <= current_.bytes()) return;
    current_ = {};
    std::uint64_t most = context_.device().max_allocation;
    if (const auto large = context_.large_buffers(); large && bytes > most) {
      most = large->most;
      kernel_ = make_kernel("gpu_bf", large->option);
      exclude_ = make_kernel("gpu_bf_exclude", large->option);
    }
    current_ = opencl::SharedBuffer(
        context_,
        opencl::grown(context_, bytes,
                      "results of gpu-bf, one byte per pair of " + std::to_string(n) + " boxes", most));
  }

  void test(const Changes& changes) {
    Changes all = changes;
    all.all = true;
    all.filters_changed = true;  // they may have, in an update without pairs to test
    all.recycled = {};           // the host takes care of them
    const Search search = objects_.upload(all);
    current_.release();
    enqueue_kernel(search);
    exclude(search, changes.exclusions.size());
    opencl::Profiler::Scope stage(profiler_, "download");
    current_.download(current_pairs_, &read_);
    if (stage.event() != nullptr) *stage.event() = read_;
  }

  void exclude(const Search& search, std::size_t count) {
    if (count == 0) return;
    opencl::set_arguments(exclude_.kernel, 0, static_cast<cl_uint>(count), search.now.slots,
                          search.now.exclusions, current_.device());
    exclude_.enqueue(context_.queue(), count);
  }

  void wait() {
    const opencl::Profiler::Scope stage(profiler_, "wait");
    read_.wait();
  }

  void enqueue_kernel(const Search& search) {
    const cl_uint n = search.now.slots;
    const unsigned period = 2 * launch_.width;
    const std::size_t columns = round_up(divide_up(n, launch_.width), kernel_.group);
    const std::size_t class_rows = (n + period - 1) / period;
    // In an average row, half of the columns are past the end.
    const std::size_t rows = launch_.rows(columns / 2 * period * class_rows, context_);
    const std::size_t chunks = (class_rows + rows - 1) / rows;
    const std::size_t seam_lines = (n + columns - 1) / columns;
    const std::size_t lines = period * chunks + seam_lines;
    const std::size_t at_once = launch_.runs_at_once(rows, n);
    for (std::size_t first = 0; first < lines; first += at_once) {
      opencl::set_arguments(kernel_.kernel, 0, n, static_cast<cl_uint>(rows), static_cast<cl_uint>(chunks),
                            static_cast<cl_uint>(first), search.now.boxes, search.now.filters,
                            current_.device());
      opencl::Profiler::Scope stage(profiler_, "test");
      context_.queue().enqueueNDRangeKernel(kernel_.kernel, cl::NullRange,
                                            cl::NDRange(columns, std::min(at_once, lines - first)),
                                            cl::NDRange(kernel_.group, 1), nullptr, stage.event());
    }
  }

  opencl::Context context_;
  opencl::Profiler profiler_;
  RowLaunch launch_;
  opencl::SizedKernel kernel_, exclude_;
  DeviceObjects objects_;
  opencl::SharedBuffer current_;   // bytes of this frame while it runs
  opencl::SharedBuffer previous_;  // bytes of the last frame
  cl::Event read_;                 // after which the host may read the bytes of this frame
  std::size_t current_pairs_ = 0;
  std::size_t previous_pairs_ = 0;
  std::vector<std::uint32_t> recycled_;
  ChangeLists lists_;
};

}  // namespace

std::unique_ptr<Algorithm> make_gpu_bf(const Config& config) {
  const Device device = select_device(config.device);
  return opencl::translate_errors(device.label(), [&] { return std::make_unique<GpuBf>(config, device); });
}

}  // namespace broadcl
