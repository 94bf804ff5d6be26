#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "base/free_lists.hpp"
#include "base/pair_lists.hpp"
#include "engines/algorithm.hpp"
#include "engines/change_lists.hpp"
#include "engines/on_device.hpp"
#include "engines/touching.hpp"
#include "finders/byte_matrix.hpp"
#include "finders/row_launch.hpp"
#include "finders/triangle.hpp"
#include "opencl/error.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {
namespace {

using opencl::divide_up;
using opencl::round_up;

/// The paper's algorithm: one byte of result per pair. The host has the bytes of this frame and of the last
/// one, and XORs them.
class GpuBf final : public OnDevice {
 public:
  GpuBf(const Config& config, const Device& device)
      : OnDevice(config, device),
        threads_(config),
        launch_(context_.launch().gpu_bf),
        large_(context_.large_buffers()),
        program_(build()),
        large_program_(large_ ? build(large_->option) : cl::Program()) {
    objects_ = std::make_unique<DeviceObjects>(context_, profiler_, *frames_);
    make_kernels();
  }

  void shrink(std::size_t slots) override {
    context_.guard([&] {
      auto frames = std::make_unique<Frames>();
      auto objects = objects_->successor(slots, *frames);
      opencl::SharedBuffer previous;
      if (previous_pairs_ > 0) {
        previous = opencl::SharedBuffer(context_, previous_pairs_);
        cl::Event mapped;
        previous.download(previous_pairs_, &mapped);
        mapped.wait();
        std::ranges::copy(bytes_of(previous_, previous_pairs_), previous.host());
      }
      make_kernels();  // for kernels own their arguments
      objects_ = std::move(objects);
      frames_ = std::move(frames);
      previous_ = std::move(previous);
      current_ = {};
      read_ = {};  // for an event may own the buffer of its command
      opencl::wait_if_possible(context_.queue());
    });
    lists_.clear();
    free_lists(recycled_);
  }

  /// Tests all pairs, regardless of what changed, and copies the results to the host.
  void begin(const Input& input) override {
    profiler_.begin();
    recycled_.assign(input.changed.recycled.begin(), input.changed.recycled.end());
    current_pairs_ = triangle::row_start(static_cast<std::uint32_t>(input.boxes.size()));
    context_.guard([&] {
      grow_results(input.boxes.size(), current_pairs_);
      if (current_pairs_ > 0) test(input);
    });
  }

  Delta finish() override {
    if (current_pairs_ > 0) {
      context_.guard([&] {
        wait();
        profiler_.resolve();
      });
    }
    if (current_pairs_ > most_pairs) {
      const auto bytes = bytes_of(current_, current_pairs_);
      refuse_too_many(bytes.size() - static_cast<std::size_t>(std::ranges::count(bytes, std::byte{0})));
    }
    Delta delta = lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
      const opencl::Profiler::Scope stage(profiler_, "xor");
      find_changes(bytes_of(previous_, previous_pairs_), bytes_of(current_, current_pairs_), recycled_, added,
                   removed);
    });
    if (current_pairs_ > 0) {
      frames_->swap();
      objects_->commit();
    }
    has_skipped_ = current_pairs_ == 0;
    std::swap(previous_, current_);
    previous_pairs_ = current_pairs_;
    lists_.commit();
    return delta;
  }

  [[nodiscard]] Touching touching(AxisSet axes) override {
    if (frames_->last.objects.ungrown() != nullptr) return {.all = true, .pairs = pairs()};
    return {.all = true, .pairs = touching_pairs(pairs(), boxes(), {}, axes, threads_)};
  }

  [[nodiscard]] std::vector<Pair> pairs() override { return pairs_of(bytes_of(previous_, previous_pairs_)); }

 private:
  [[nodiscard]] static std::vector<Pair> pairs_of(std::span<const std::byte> results) {
    std::vector<Pair> found;
    std::vector<Pair> none;
    find_changes({}, results, {}, found, none);
    return found;
  }

  [[nodiscard]] static std::span<const std::byte> bytes_of(const opencl::SharedBuffer& results,
                                                           std::size_t pairs) {
    return {results.host(), pairs};
  }

  [[nodiscard]] cl::Program build(const std::string& option = {}) const {
    return context_.program("gpu_bf.cl", "-DWIDTH=" + std::to_string(launch_.width) + option);
  }

  void make_kernels() {
    kernel_ = context_.sized_kernel(program_, "gpu_bf", launch_.group);
    exclude_ = context_.sized_kernel(program_, "gpu_bf_exclude", launch_.group);
  }

  /// Grows the buffer of this frame's results. Those of the last frame are not changed.
  void grow_results(std::size_t n, std::size_t pairs) {
    const std::size_t bytes = round_up(pairs, launch_.width);
    if (bytes <= current_.bytes()) return;
    current_ = {};
    std::uint64_t most = context_.device().max_allocation;
    if (large_ && bytes > most) {
      most = large_->most;
      program_ = large_program_;
      make_kernels();
    }
    current_ = opencl::SharedBuffer(
        context_,
        opencl::grown(context_, bytes,
                      "results of gpu-bf, one byte per pair of " + std::to_string(n) + " boxes", most));
  }

  void test(const Input& input) {
    Input all = input;
    all.changed.all = true;
    all.rules.all_changed = input.rules.all_changed || has_skipped_;
    const Search search = objects_->upload(all);
    current_.release();
    enqueue_kernel(search);
    exclude(search, input.rules.exclusions.size());
    opencl::Profiler::Scope stage(profiler_, "download");
    current_.download(current_pairs_, &read_);
    if (cl::Event* const event = stage.event()) *event = read_;
  }

  void exclude(const Search& search, std::size_t count) {
    if (count == 0) return;
    opencl::set_arguments(exclude_.kernel, 0, static_cast<cl_uint>(count), search.now.slots,
                          search.now.exclusions, current_.device());
    opencl::Profiler::Scope stage(profiler_, "test");
    exclude_.enqueue(context_.queue(), count, stage.event());
  }

  void wait() {
    const opencl::Profiler::Scope stage(profiler_, "wait");
    read_.wait();
  }

  void enqueue_kernel(const Search& search) {
    const cl_uint n = search.now.slots;
    const unsigned period = triangle::row_period(launch_.width);
    const std::size_t columns = round_up(divide_up(n, launch_.width), kernel_.group);
    const std::size_t class_rows = (n + period - 1) / period;
    // In an average row, half of the columns are past the end.
    const std::size_t rows = rows_per_item(launch_, columns / 2 * period * class_rows, context_);
    const std::size_t chunks = (class_rows + rows - 1) / rows;
    const std::size_t seam_lines = (n + columns - 1) / columns;
    const std::size_t lines = period * chunks + seam_lines;
    const std::size_t at_once = runs_at_once(launch_, rows, n);
    for (std::size_t first = 0; first < lines; first += at_once) {
      opencl::set_arguments(kernel_.kernel, 0, n, static_cast<cl_uint>(rows), static_cast<cl_uint>(chunks),
                            static_cast<cl_uint>(first), search.now.boxes, search.now.filters,
                            search.now.ungrown, current_.device());
      opencl::Profiler::Scope stage(profiler_, "test");
      context_.queue().enqueueNDRangeKernel(kernel_.kernel, cl::NullRange,
                                            cl::NDRange(columns, std::min(at_once, lines - first)),
                                            cl::NDRange(kernel_.group, 1), nullptr, stage.event());
    }
  }

  Threads threads_;  // at most; 0 for one per processor
  const opencl::RowLaunch& launch_;
  std::optional<opencl::Context::LargeBuffers> large_;
  cl::Program program_;
  cl::Program large_program_;  // for large buffers
  opencl::SizedKernel kernel_, exclude_;
  std::unique_ptr<Frames> frames_ = std::make_unique<Frames>();  // the objects of each
  opencl::SharedBuffer current_;                                 // bytes of this frame while it runs
  opencl::SharedBuffer previous_;                                // bytes of the last frame
  cl::Event read_;  // after which the host may read the bytes of this frame
  std::size_t current_pairs_ = 0;
  std::size_t previous_pairs_ = 0;
  bool has_skipped_ = false;  // whether the last update was not uploaded, as it had no pairs to test
  std::vector<std::uint32_t> recycled_;
  ChangeLists lists_;
};

}  // namespace

AlgorithmPointer make_gpu_bf(const Config& config) {
  const Device device = select_device(config.device);
  return opencl::translate_errors(device.label(), [&] { return std::make_unique<GpuBf>(config, device); });
}

}  // namespace broadcl
