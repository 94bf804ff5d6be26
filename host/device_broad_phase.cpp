#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/aabb.hpp>
#include <broadcl/opencl.hpp>

#include <array>
#include <utility>

#include "algorithms/algorithm.hpp"
#include "algorithms/engine.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/growing_buffer.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

constexpr std::size_t group = 64;
constexpr std::size_t most_boxes = 0x7fffffff;

cl::CommandQueue retained(cl_command_queue queue, bool profile) {
  if (queue == nullptr) throw Error("the queue is null; give one that was made by clCreateCommandQueue");
  cl::CommandQueue result(queue, true);
  const auto properties =
      opencl::translate_errors("the queue", [&] { return result.getInfo<CL_QUEUE_PROPERTIES>(); });
  if (profile && (properties & CL_QUEUE_PROFILING_ENABLE) == 0) {
    throw Error(
        "Config::profile is set, but the queue does not measure; make it with CL_QUEUE_PROFILING_ENABLE");
  }
  return result;
}

}  // namespace

class DeviceBroadPhase::Impl {
 public:
  Impl(cl_command_queue queue, const Config& config)
      : context_(retained(queue, config.profile)),
        profiler_(config.profile),
        engine_(context_.guard([&] {
          return std::make_unique<Engine>(context_, profiler_, find_pair_finder(config.algorithm),
                                          Order::Target::device);
        })),
        gather_(context_.guard([&] { return cl::Kernel(context_.program("changes.cl"), "gather_boxes"); })) {}

  void begin(const Boxes& boxes) {
    if (in_flight_) throw Error("begin() was called twice; call finish() in between");
    context_.guard([&] {
      check(boxes);
      profiler_.begin();
      engine_->prepare();
      gather(boxes);
      copy_filters(boxes);
      const Generation& now = frames_.at(1 - turn_).objects;
      engine_->begin({.now = now,
                      .last = frames_.at(turn_).objects,
                      .worlds = boxes.worlds && boxes.filters != nullptr});
      context_.queue().flush();
    });
    in_flight_ = true;
  }

  Result finish() {
    if (!in_flight_) throw Error("finish() was called without begin()");
    in_flight_ = false;
    const PairDelta::Counts counts = context_.guard([&] { return engine_->finish(); });
    turn_ = 1 - turn_;
    Result result{.added = {engine_->changes().added()(), counts.added},
                  .removed = {engine_->changes().removed()(), counts.removed},
                  .pair_count = counts.found,
                  .invalid_boxes = counts.invalid_boxes,
                  .first_invalid = {}};
    if (counts.invalid_boxes > 0) result.first_invalid = static_cast<std::uint32_t>(counts.first_invalid);
    return result;
  }

  PairBuffer pairs() {
    if (in_flight_) throw Error("pairs() was called between begin() and finish(); call finish() first");
    return context_.guard([&]() -> PairBuffer {
      pairs_ = engine_->sorted_pairs();
      return {pairs_(), engine_->pair_count()};
    });
  }

  [[nodiscard]] const opencl::Context& context() const noexcept { return context_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profiler_.stages(); }

 private:
  /// Objects as of one update.
  struct Frame {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    Generation objects;
    opencl::GrowingBuffer boxes, filters;
  };

  void check(const Boxes& boxes) const {
    if (boxes.count == 0) return;
    if (boxes.buffer == nullptr) throw Error("the buffer of boxes is null; give one of the queue's context");
    if (boxes.count > most_boxes) throw Error("more than 2147483647 boxes; give fewer");
    if (boxes.offset % sizeof(float) != 0 || boxes.stride % sizeof(float) != 0) {
      throw Error("offset and stride of the boxes must be multiples of 4 bytes");
    }
    check_buffer("boxes", boxes.buffer, boxes.count, boxes.offset, boxes.stride, sizeof(Aabb));
    if (boxes.filters == nullptr) return;
    check_buffer("filters", boxes.filters, boxes.count, 0, sizeof(Filter), sizeof(Filter));
  }

  /// Refuses a buffer of another context, and one that is too small for this many items.
  void check_buffer(const std::string& what, cl_mem memory, std::size_t count, std::size_t offset,
                    std::size_t stride, std::size_t size) const {
    const cl::Buffer buffer(memory, true);
    if (buffer.getInfo<CL_MEM_CONTEXT>()() != context_.context()()) {
      throw Error("the buffer of " + what + " is of another context; give one of the queue's context");
    }
    const auto bytes = buffer.getInfo<CL_MEM_SIZE>();
    const bool fits = offset <= bytes && size <= bytes - offset &&
                      (count == 1 || stride <= (bytes - offset - size) / (count - 1));
    if (!fits) {
      throw Error("the buffer of " + what + " has " + std::to_string(bytes) + " bytes, too few for " +
                  std::to_string(count) + " at " + std::to_string(offset) + " with a stride of " +
                  std::to_string(stride) + "; check count, offset and stride");
    }
  }

  void gather(const Boxes& boxes) {
    Frame& next = frames_.at(1 - turn_);
    next.boxes.reserve(context_, (boxes.count + Generation::padding) * sizeof(Aabb), "boxes");
    next.objects.slots = static_cast<cl_uint>(boxes.count);
    next.objects.boxes = next.boxes.get();
    if (boxes.count == 0) return;
    opencl::Profiler::Scope stage(profiler_, "gather");
    opencl::set_arguments(gather_, 0, static_cast<cl_uint>(boxes.count), cl::Buffer(boxes.buffer, true),
                          static_cast<cl_ulong>(boxes.offset / sizeof(float)),
                          static_cast<cl_ulong>(boxes.stride / sizeof(float)), next.objects.boxes,
                          engine_->counts());
    context_.queue().enqueueNDRangeKernel(gather_, cl::NullRange,
                                          cl::NDRange(opencl::round_up(boxes.count, group)),
                                          cl::NDRange(group), nullptr, stage.event());
  }

  void copy_filters(const Boxes& boxes) {
    Frame& next = frames_.at(1 - turn_);
    next.objects.filters = {};
    if (boxes.filters == nullptr || boxes.count == 0) return;
    next.filters.reserve(context_, (boxes.count + Generation::padding) * sizeof(Filter), "filters");
    next.objects.filters = next.filters.get();
    context_.queue().enqueueCopyBuffer(cl::Buffer(boxes.filters, true), next.objects.filters, 0, 0,
                                       boxes.count * sizeof(Filter));
  }

  opencl::Context context_;
  opencl::Profiler profiler_;
  std::unique_ptr<Engine> engine_;
  cl::Kernel gather_;
  std::array<Frame, 2> frames_;  // of the last update and of the next, in turn
  std::size_t turn_ = 0;         // index of the frame of the last update
  cl::Buffer pairs_;
  bool in_flight_ = false;
};

DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue) : DeviceBroadPhase(queue, Config()) {}
DeviceBroadPhase::DeviceBroadPhase(cl_command_queue queue, const Config& config)
    : impl_(std::make_unique<Impl>(queue, config)) {}
DeviceBroadPhase::~DeviceBroadPhase() = default;
DeviceBroadPhase::DeviceBroadPhase(DeviceBroadPhase&&) noexcept = default;
DeviceBroadPhase& DeviceBroadPhase::operator=(DeviceBroadPhase&&) noexcept = default;

DeviceBroadPhase::Result DeviceBroadPhase::update(const Boxes& boxes) {
  impl_->begin(boxes);
  return impl_->finish();
}

void DeviceBroadPhase::begin(const Boxes& boxes) {
  impl_->begin(boxes);
}

DeviceBroadPhase::Result DeviceBroadPhase::finish() {
  return impl_->finish();
}

DeviceBroadPhase::PairBuffer DeviceBroadPhase::pairs() {
  return impl_->pairs();
}

const Device& DeviceBroadPhase::device() const noexcept {
  return impl_->context().device();
}

MemoryUse DeviceBroadPhase::memory() const noexcept {
  return impl_->context().memory();
}

std::span<const Stage> DeviceBroadPhase::profile() const noexcept {
  return impl_->profile();
}

}  // namespace broadcl
