#include "algorithms/pair_delta.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

#include "opencl/error.hpp"

namespace broadcl {
namespace {

// As kernels/delta.h has them.
constexpr std::size_t count_found = 0;
constexpr std::size_t count_found_high = 1;
constexpr std::size_t count_added = 2;
constexpr std::size_t count_removed = 3;
constexpr std::size_t count_bytes = 4 * sizeof(cl_uint);

constexpr std::size_t first_capacity = 1 << 14;
constexpr std::size_t most_pairs = std::size_t{1} << 31;  // places in a list are 32-bit numbers
/// Pairs of a list, added or removed, that the device puts in order, each compared with every other; longer
/// lists are ordered on the host.
std::size_t most_ordered(const opencl::Context& context) {
  return context.shape() == opencl::Shape::cpu ? 1 << 8 : 1 << 15;
}
constexpr std::size_t least_ordered = 256;

// As kernels/delta.cl has them.
constexpr std::size_t teams = 2;
constexpr std::size_t keys = 4;

constexpr std::size_t sweep_group = 64;

/// Work-items that place pairs together.
std::size_t parts(const opencl::Context& context) {
  return context.shape() == opencl::Shape::cpu ? 1 : 64;
}

std::size_t round_up(std::size_t value, std::size_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

PairDelta::PairDelta(const opencl::Context& context, opencl::Profiler& profiler)
    : context_(context), profiler_(profiler) {
  const cl::Program program = context.program("delta.cl", "-DPARTS=" + std::to_string(parts(context)));
  opencl::translate_errors(context.device().label(), [&] {
    sweep_ = cl::Kernel(program, "delta_sweep");
    order_ = cl::Kernel(program, "delta_order");
    for (cl::Buffer& counts : counts_) counts = zeros(count_bytes);
    renewed_ = opencl::SharedBuffer(context, 1);
    reserve(first_capacity);
  });
}

cl::Buffer PairDelta::zeros(std::size_t bytes) const {
  if (bytes > context_.device().max_allocation) {
    throw Error(context_.device().label() + ": needs a buffer of " + std::to_string(bytes) +
                " bytes for the overlapping pairs, but the device allocates " +
                std::to_string(context_.device().max_allocation) +
                " at most; use fewer boxes, or a device with more memory");
  }
  cl::Buffer buffer(context_.context(), CL_MEM_READ_WRITE, bytes);
  context_.queue().enqueueFillBuffer(buffer, cl_uint{0}, 0, bytes);
  return buffer;
}

PairDelta::Frame PairDelta::make_frame(std::size_t capacity) const {
  Frame frame;
  if (capacity > most_pairs) {
    throw Error(context_.device().label() + ": more than " + std::to_string(most_pairs) +
                " pairs overlap; use fewer boxes");
  }
  capacity = round_up(capacity, 64);
  const std::size_t entries = std::bit_ceil(2 * capacity);
  frame.capacity = static_cast<cl_uint>(capacity);
  frame.mask = static_cast<cl_uint>(entries - 1);
  frame.pairs = zeros(capacity * sizeof(Pair));
  frame.table = zeros(entries * sizeof(cl_uint));
  frame.kept = zeros(capacity);
  return frame;
}

/// Makes room for this many pairs in this frame. Nothing changes where it fails.
void PairDelta::reserve(std::size_t capacity) {
  if (frame_.capacity >= capacity) return;
  Frame frame = make_frame(capacity);
  Frame last = last_.capacity == 0 ? make_frame(capacity) : last_;
  cl::Buffer added = zeros(frame.capacity * sizeof(Pair));
  cl::Buffer removed = zeros(last.capacity * sizeof(Pair));
  opencl::SharedBuffer result(context_,
                              count_bytes + (std::size_t{frame.capacity} + last.capacity) * sizeof(Pair));
  frame_ = std::move(frame);
  last_ = std::move(last);
  added_ = std::move(added);
  removed_ = std::move(removed);
  result_ = std::move(result);
}

void PairDelta::upload_renewed(std::size_t slots, std::span<const std::uint32_t> renewed) {
  any_renewed_ = renewed.empty() ? 0 : 1;
  if (renewed.empty()) return;
  slots = std::max<std::size_t>(slots, renewed.back() + 1);
  if (renewed_.bytes() < slots) renewed_ = opencl::SharedBuffer(context_, slots + slots / 2);
  std::memset(renewed_.host(), 0, slots);
  for (const std::uint32_t slot : renewed) renewed_.host()[slot] = std::byte{1};
  renewed_.upload(slots);
}

void PairDelta::set_sink(cl::Kernel& kernel, cl_uint first) const {
  kernel.setArg(first++, frame_.capacity);
  kernel.setArg(first++, frame_.pairs);
  kernel.setArg(first++, frame_.table);
  kernel.setArg(first++, frame_.mask);
  kernel.setArg(first++, last_.pairs);
  kernel.setArg(first++, last_.table);
  kernel.setArg(first++, last_.mask);
  kernel.setArg(first++, last_.kept);
  kernel.setArg(first++, any_renewed_);
  kernel.setArg(first++, renewed_.device());
  kernel.setArg(first++, added_);
  kernel.setArg(first++, counts_[turn_]);
}

/// @param ordered How many pairs of each list to put in order, at least.
void PairDelta::enqueue_delta(std::size_t ordered) {
  const cl::CommandQueue& queue = context_.queue();
  {
    opencl::Profiler::Scope stage(profiler_, "sweep");
    cl_uint k = 0;
    sweep_.setArg(k++, frame_.capacity);
    sweep_.setArg(k++, last_.pairs);
    sweep_.setArg(k++, last_.found);
    sweep_.setArg(k++, last_.table);
    sweep_.setArg(k++, last_.mask);
    sweep_.setArg(k++, last_.kept);
    sweep_.setArg(k++, removed_);
    sweep_.setArg(k++, counts_[turn_]);
    const std::size_t useful = context_.device().compute_units * std::size_t{1024};
    const std::size_t items = round_up(std::min<std::size_t>(last_.mask, useful), sweep_group);
    queue.enqueueNDRangeKernel(sweep_, cl::NullRange, cl::NDRange(items), cl::NDRange(sweep_group), nullptr,
                               stage.event());
  }
  opencl::Profiler::Scope stage(profiler_, "order");
  result_.lend();
  cl_uint k = 0;
  order_.setArg(k++, frame_.capacity);
  order_.setArg(k++, added_);
  order_.setArg(k++, removed_);
  order_.setArg(k++, counts_[turn_]);
  order_.setArg(k++, counts_[1 - turn_]);
  order_.setArg(k++, result_.device());
  queue.enqueueNDRangeKernel(order_, cl::NullRange, cl::NDRange(parts(context_), ordered / keys, 2),
                             cl::NDRange(parts(context_), teams, 1), nullptr, stage.event());
}

void PairDelta::read_result(std::size_t changes) {
  {
    opencl::Profiler::Scope stage(profiler_, "download");
    result_.download(std::min(result_.bytes(), count_bytes + changes * sizeof(Pair)), stage.event());
  }
  const opencl::Profiler::Scope stage(profiler_, "wait");
  context_.queue().finish();
}

const cl_uint* PairDelta::counts() const {
  return reinterpret_cast<const cl_uint*>(result_.host());
}

std::span<Pair> PairDelta::changes(std::size_t total) const {
  return {reinterpret_cast<Pair*>(result_.host() + count_bytes), total};
}

Delta PairDelta::update(std::size_t slots, std::span<const std::uint32_t> renewed,
                        const std::function<void()>& find) {
  reserve(last_.capacity);
  upload_renewed(slots, renewed);
  const std::size_t expected = expected_changes_ + expected_changes_ / 2;
  const std::size_t longest = longest_list_ + longest_list_ / 2;
  const std::size_t ordered =
      round_up(std::clamp(longest, least_ordered, most_ordered(context_)), teams * keys);
  for (;;) {
    find();
    enqueue_delta(ordered);
    if (any_renewed_ != 0) renewed_.reclaim();
    read_result(expected);
    turn_ = 1 - turn_;
    const std::uint64_t found = counts()[count_found] | std::uint64_t{counts()[count_found_high]} << 32;
    if (found <= frame_.capacity) break;
    // Before anything can fail: this frame's table and the marks of what was kept are half written.
    context_.queue().enqueueFillBuffer(frame_.table, cl_uint{0}, 0,
                                       (std::size_t{frame_.mask} + 1) * sizeof(cl_uint));
    context_.queue().enqueueFillBuffer(last_.kept, cl_uint{0}, 0, last_.capacity);
    reserve(found + found / 4);
    if (any_renewed_ != 0) renewed_.upload(renewed_.bytes());
  }

  const std::size_t added = counts()[count_added];
  const std::size_t removed = counts()[count_removed];
  const std::size_t total = added + removed;
  if (total > expected) read_result(total);
  profiler_.resolve();
  const std::span<Pair> all = changes(total);
  longest_list_ = std::max(added, removed);
  if (longest_list_ > ordered) {
    const auto middle = all.begin() + static_cast<std::ptrdiff_t>(added);
    std::sort(all.begin(), middle);
    std::sort(middle, all.end());
  }
  frame_.found = counts()[count_found];
  expected_changes_ = total;
  std::swap(frame_, last_);
  return {all.first(added), all.subspan(added)};
}

std::vector<Pair> PairDelta::pairs() const {
  std::vector<Pair> all(last_.found);
  if (all.empty()) return all;
  context_.queue().enqueueReadBuffer(last_.pairs, CL_TRUE, 0, all.size() * sizeof(Pair), all.data());
  std::sort(all.begin(), all.end());
  return all;
}

}  // namespace broadcl
