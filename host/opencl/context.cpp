#include "opencl/context.hpp"

#include <algorithm>
#include <bit>
#include <mutex>
#include <utility>

#include "opencl/arithmetic.hpp"
#include "opencl/common_program.hpp"
#include "opencl/devices.hpp"
#include "opencl/error.hpp"

namespace broadcl::opencl {

Context::Context(const Device& device, bool profile, CompileHandler on_compile, std::optional<Tuning> tuning)
    : on_compile_(std::move(on_compile)) {
  translate_errors(device.label(), [&] {
    opened_ = opened_device(device);
    const cl::Device& cl_device = opened_->cl_device;
    if (profile && (cl_device.getInfo<CL_DEVICE_QUEUE_PROPERTIES>() & CL_QUEUE_PROFILING_ENABLE) == 0) {
      throw Error(device.label() + ": the device has no profiling; do not request it");
    }
    open(cl::CommandQueue(context(), cl_device, profile ? CL_QUEUE_PROFILING_ENABLE : 0), tuning);
    owns_queue_ = true;
  });
}

Context::Context(const cl::CommandQueue& queue, CompileHandler on_compile, std::optional<Tuning> tuning)
    : on_compile_(std::move(on_compile)) {
  const std::string label = describe(queue).label();
  translate_errors(label, [&] {
    if ((queue.getInfo<CL_QUEUE_PROPERTIES>() & CL_QUEUE_OUT_OF_ORDER_EXEC_MODE_ENABLE) != 0) {
      throw Error::invalid_argument(label + ": the queue is out of order; give one that is in order");
    }
    opened_ = opened_device(queue);
    open(queue, tuning);
  });
}

Context::~Context() {
  life_.reset();
  if (owns_queue_) wait_if_possible(queue_);
}

void Context::open(const cl::CommandQueue& queue, std::optional<Tuning> tuning) {
  queue_ = queue;
  const auto known = [&] {
    const std::scoped_lock lock(opened_->mutex);
    return opened_->findings;
  }();
  if (known) {
    findings_ = *known;
  } else {
    test_device();  // without the lock, because of on_compile
    const std::scoped_lock lock(opened_->mutex);
    opened_->findings = findings_;
  }
  tuning_ = opened_->named_tuning.value_or(tuning.value_or(findings_.suitable_tuning));
}

void Context::test_device() {
  const bool is_tuning_named = opened_->named_tuning.has_value();
  if (!is_tuning_named) {
    findings_.suitable_tuning = suitable_tuning();
    findings_.has_nvidia_vote = opencl::has_nvidia_vote(opened_->cl_device);
  }
  if (flushes_denormals(*this)) findings_.options += " -DFLUSHES=1";
  if (is_tuning_named || device().host_unified) return;
  findings_.create_direct = find_direct_memory(opened_->cl_device);
  if (findings_.create_direct != nullptr && !is_direct_memory_coherent(*this))
    findings_.create_direct = nullptr;
}

Tuning Context::suitable_tuning() const {
  // What kernels that are tuned for GPUs need.
  constexpr std::size_t group = 256;
  constexpr cl_ulong local_memory = 32 << 10;
  const bool wants_few_work_items = device().type == DeviceType::cpu && !opened_->quirks.ends_long_loops;
  if (wants_few_work_items || opened_->largest_group < group || opened_->local_memory < local_memory)
    return Tuning::cpu;
  return has_waves_of_64() ? Tuning::gpu64 : Tuning::gpu;
}

/// Whether a GPU runs 64 work-items in lockstep. (With OpenCL's embedded profile, it may have no 64-bit
/// integers.)
bool Context::has_waves_of_64() const {
  constexpr std::size_t wave = 64;
  const cl::Device& cl_device = opened_->cl_device;
  if (device().type != DeviceType::gpu || cl_device.getInfo<CL_DEVICE_PROFILE>() != "FULL_PROFILE")
    return false;
  if (const cl_uint reported = reported_wave(cl_device); reported != 0) return reported == wave;
  const cl::Kernel any(program("arithmetic.cl"), "arithmetic");
  return any.getWorkGroupInfo<CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE>(cl_device) == wave;
}

/// Work-items per work-group of a kernel, at most.
std::size_t Context::largest_group(const cl::Kernel& kernel) const {
  if (opened_->quirks.misjudges_kernels) return opened_->largest_group;
  return std::min(opened_->largest_group,
                  kernel.getWorkGroupInfo<CL_KERNEL_WORK_GROUP_SIZE>(opened_->cl_device));
}

/// Bytes per work-group that a kernel needs.
cl_ulong Context::local_memory(const cl::Kernel& kernel) const {
  if (opened_->quirks.misjudges_kernels) return 0;
  return kernel.getWorkGroupInfo<CL_KERNEL_LOCAL_MEM_SIZE>(opened_->cl_device);
}

cl::Kernel Context::kernel(const cl::Program& program, const char* name, std::size_t group) const {
  cl::Kernel kernel(program, name);
  const std::size_t allowed = largest_group(kernel);
  const cl_ulong memory = local_memory(kernel);
  if (allowed >= group && memory <= opened_->local_memory) return kernel;
  const std::string what =
      device().label() + ": the kernel " + name + " needs " +
      (allowed < group
           ? "work-groups of " + std::to_string(group) + ", but the device allows " + std::to_string(allowed)
           : std::to_string(memory) + " bytes of local memory, but the device has " +
                 std::to_string(opened_->local_memory));
  if (allowed == 0 || group == 1) throw Error(what + "; use another device");
  if (opened_->named_tuning) throw Error(what + "; set BROADCL_TUNING=cpu, which uses smaller ones");
  throw GroupTooLarge(what);
}

SizedKernel Context::sized_kernel(const cl::Program& program, const char* name, std::size_t wanted) const {
  cl::Kernel kernel = this->kernel(program, name, 1);
  const std::size_t group = std::bit_floor(std::min(wanted, largest_group(kernel)));
  return {std::move(kernel), group};
}

cl::CommandQueue Context::second_queue() const {
  return {context(), opened_->cl_device, queue_.getInfo<CL_QUEUE_PROPERTIES>()};
}

void Context::fill(const cl::CommandQueue& queue, const cl::Buffer& buffer, cl_uint value, std::size_t first,
                   std::size_t count, cl::Event* event) const {
  if (fill_.kernel() == nullptr) fill_ = sized_kernel(common_program(*this), "fill");
  set_arguments(fill_.kernel, 0, static_cast<cl_uint>(count), value, static_cast<cl_ulong>(first), buffer);
  // A GPU takes longer for work-items that set only one word.
  constexpr std::size_t most_items = std::size_t{1} << 18;
  fill_.enqueue(queue, std::min(count, most_items), event);
}

std::optional<Context::LargeBuffers> Context::large_buffers() const {
  if (!opened_->quirks.has_large_buffers) return std::nullopt;
  return LargeBuffers{.option = " -cl-intel-greater-than-4GB-buffer-required", .most = device().memory};
}

cl::Buffer Context::create(std::size_t bytes, cl_mem_flags flags) const {
  if (bytes > device().max_allocation && opened_->quirks.has_large_buffers) {
    constexpr cl_mem_flags allow_unrestricted_size = 1 << 23;  // CL_MEM_ALLOW_UNRESTRICTED_SIZE_INTEL
    flags |= allow_unrestricted_size;
  }
  return {context(), CL_MEM_READ_WRITE | flags, bytes};
}

/// Counts a buffer as long as it exists.
cl::Buffer Context::counted(cl::Buffer buffer, std::size_t bytes,
                            std::atomic<std::size_t> Memory::*counter) const {
  struct Claim {
    std::shared_ptr<Memory> memory;
    std::atomic<std::size_t> Memory::*counter;
    std::size_t bytes;
  };
  std::unique_ptr<Claim> claim(new Claim{memory_, counter, bytes});
  buffer.setDestructorCallback(
      [](cl_mem /*buffer*/, void* data) {
        const std::unique_ptr<Claim> ended(static_cast<Claim*>(data));
        *ended->memory.*ended->counter -= ended->bytes;
      },
      claim.get());
  (void)claim.release();  // the callback owns it now
  *memory_.*counter += bytes;
  memory_->device_peak = std::max<std::size_t>(memory_->device_peak, memory_->device);
  return buffer;
}

cl::Buffer Context::buffer(std::size_t bytes, cl_mem_flags flags) const {
  return counted(create(bytes, flags), bytes, &Memory::device);
}

cl::Buffer Context::pinned(std::size_t bytes) const {
  return counted(create(bytes, CL_MEM_ALLOC_HOST_PTR), bytes, &Memory::pinned);
}

cl::Buffer Context::direct(std::size_t bytes) const {
  return counted(create_direct(findings_.create_direct, context(), bytes), bytes, &Memory::pinned);
}

MemoryUse Context::memory() const noexcept {
  return {.device = memory_->device, .device_peak = memory_->device_peak, .pinned = memory_->pinned};
}

cl::Program Context::program(std::string_view file, const std::string& options) const {
  return translate_errors(device().label(), [&] {
    return opened_->programs.get(file, findings_.options + " " + options, on_compile_);
  });
}

}  // namespace broadcl::opencl
