#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <broadcl/aabb.hpp>
#include <broadcl/opencl.hpp>

#include <array>
#include <cstring>
#include <utility>

#include "algorithms/algorithm.hpp"
#include "algorithms/pair_delta.hpp"
#include "algorithms/pair_finder.hpp"
#include "algorithms/scoped_timer.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"
#include "opencl/shared_buffer.hpp"

namespace broadcl {
namespace {

constexpr std::size_t group = 64;

/// As kernels/changes.cl counts them.
struct Bad {
  cl_uint count = 0;
  cl_uint first = 0xffffffff;
};

cl::CommandQueue retained(cl_command_queue queue) {
  if (queue == nullptr) throw Error("the queue is null; give one that was made by clCreateCommandQueue");
  return cl::CommandQueue(queue, true);
}

void refuse_short(const char* what, const cl::Buffer& buffer, std::size_t bytes) {
  const auto size = buffer.getInfo<CL_MEM_SIZE>();
  if (size < bytes) {
    throw Error(std::string("the buffer of ") + what + " has " + std::to_string(size) + " bytes, of which " +
                std::to_string(bytes) + " were to be read; check count, offset and stride");
  }
}

}  // namespace

class DeviceBroadPhase::Impl {
  template <class Function>
  decltype(auto) translate(Function&& function) {
    return opencl::translate_errors(context_.device().label(), std::forward<Function>(function));
  }

 public:
  Impl(cl_command_queue queue, const Config& config)
      : context_(retained(queue)),
        profiler_(config.profile),
        delta_(context_, profiler_),
        finder_(find_pair_finder(config.algorithm)(context_)) {
    const cl::Program program = context_.program("changes.cl");
    translate([&] {
      gather_ = cl::Kernel(program, "gather_boxes");
      bad_ = opencl::SharedBuffer(context_, sizeof(Bad));
      unused_ = context_.buffer(sizeof(cl_uint));
    });
  }

  void begin(const Boxes& boxes) {
    if (in_flight_) throw Error("begin() was called twice; call finish() in between");
    seconds_ = 0;
    const ScopedTimer timer(seconds_);
    translate([&] {
      check(boxes);
      profiler_.begin();
      gather(boxes);
      copy_filters(boxes);
      const Frame& last = frames_[turn_];
      const Frame& next = frames_[1 - turn_];
      search_ = {.slots = static_cast<cl_uint>(boxes.count),
                 .boxes = next.boxes,
                 .filters = next.any_filters ? next.filters : unused_,
                 .any_filters = next.any_filters,
                 .worlds = boxes.worlds && next.any_filters,
                 .changed = unused_,
                 .stamps = {.words = unused_},
                 .last_slots = last.slots,
                 .last_boxes = last.boxes,
                 .last_filters = last.any_filters ? last.filters : unused_,
                 .any_last_filters = last.any_filters};
      delta_.begin({.search = search_,
                    .find = [this] { finder_->find(search_, delta_, profiler_); },
                    .stays_on_device = true});
      context_.queue().flush();
    });
    in_flight_ = true;
  }

  Result finish() {
    if (!in_flight_) throw Error("finish() was called without begin()");
    in_flight_ = false;
    const PairDelta::OnDevice changes = [&] {
      const ScopedTimer timer(seconds_);
      return translate([&] { return delta_.finish_on_device(); });
    }();
    turn_ = 1 - turn_;
    finder_->ended(seconds_);
    Bad bad;
    std::memcpy(&bad, bad_.host(), sizeof(Bad));
    return {.added = {changes.added(), changes.added_count},
            .removed = {changes.removed(), changes.removed_count},
            .pairs = changes.found,
            .bad_boxes = bad.count,
            .first_bad = bad.count > 0 ? bad.first : 0};
  }

  PairBuffer pairs() {
    if (in_flight_) throw Error("pairs() was called between begin() and finish(); call finish() first");
    return translate([&]() -> PairBuffer {
      pairs_ = delta_.sorted_pairs();
      return {pairs_(), delta_.pair_count()};
    });
  }

  [[nodiscard]] const opencl::Context& context() const noexcept { return context_; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return profiler_.stages(); }

 private:
  static void check(const Boxes& boxes) {
    if (boxes.count == 0) return;
    if (boxes.buffer == nullptr) throw Error("the buffer of boxes is null; give one of the queue's context");
    if (boxes.count > 0x7fffffff) throw Error("more than 2147483647 boxes; give fewer");
    if (boxes.offset % sizeof(float) != 0 || boxes.stride % sizeof(float) != 0) {
      throw Error("offset and stride of the boxes must be multiples of 4 bytes");
    }
    refuse_short("boxes", cl::Buffer(boxes.buffer, true),
                 boxes.offset + (boxes.count - 1) * boxes.stride + sizeof(Aabb));
    if (boxes.filters == nullptr) return;
    refuse_short("filters", cl::Buffer(boxes.filters, true), boxes.count * sizeof(Filter));
  }

  void gather(const Boxes& boxes) {
    Frame& next = frames_[1 - turn_];
    next.slots = static_cast<cl_uint>(boxes.count);
    grow(next.boxes, boxes.count, sizeof(Aabb));
    const Bad none;
    std::memcpy(bad_.host(), &none, sizeof(Bad));
    opencl::Profiler::Scope stage(profiler_, "gather");
    bad_.upload(sizeof(Bad));
    if (boxes.count > 0) {
      opencl::set_arguments(gather_, 0, static_cast<cl_uint>(boxes.count), cl::Buffer(boxes.buffer, true),
                            static_cast<cl_ulong>(boxes.offset / sizeof(float)),
                            static_cast<cl_ulong>(boxes.stride / sizeof(float)), next.boxes, bad_.device());
      context_.queue().enqueueNDRangeKernel(gather_, cl::NullRange,
                                            cl::NDRange(opencl::round_up(boxes.count, group)),
                                            cl::NDRange(group), nullptr, stage.event());
    }
    bad_.download(sizeof(Bad));
  }

  void copy_filters(const Boxes& boxes) {
    Frame& next = frames_[1 - turn_];
    next.any_filters = boxes.filters != nullptr;
    if (!next.any_filters) return;
    grow(next.filters, boxes.count, sizeof(Filter));
    if (boxes.count == 0) return;
    context_.queue().enqueueCopyBuffer(cl::Buffer(boxes.filters, true), next.filters, 0, 0,
                                       boxes.count * sizeof(Filter));
  }

  /// Makes room for so many items, and for kernels that read past the last one.
  void grow(cl::Buffer& buffer, std::size_t count, std::size_t size) const {
    const std::size_t bytes = (count + Search::padding) * size;
    if (buffer() != nullptr && buffer.getInfo<CL_MEM_SIZE>() >= bytes) return;
    buffer = context_.buffer(bytes + bytes / 2);
  }

  /// Objects as of one update.
  struct Frame {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
    cl_uint slots = 0;
    cl::Buffer boxes;
    bool any_filters = false;
    cl::Buffer filters;
  };

  opencl::Context context_;
  opencl::Profiler profiler_;
  PairDelta delta_;
  std::unique_ptr<PairFinder> finder_;
  Search search_;  // of the update that was begun
  cl::Kernel gather_;
  std::array<Frame, 2> frames_;  // of the last update and of the next, in turn
  std::size_t turn_ = 0;
  cl::Buffer unused_;  // stands where a kernel reads nothing
  cl::Buffer pairs_;
  opencl::SharedBuffer bad_;
  bool in_flight_ = false;
  double seconds_ = 0;  // that the update has taken of the caller's time
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

std::span<const Stage> DeviceBroadPhase::profile() const noexcept {
  return impl_->profile();
}

}  // namespace broadcl
