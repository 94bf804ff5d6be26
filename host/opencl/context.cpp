#include "opencl/context.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <utility>
#include <vector>

#include "opencl/arithmetic.hpp"
#include "opencl/devices.hpp"
#include "opencl/error.hpp"
#include "opencl/kernel_source.hpp"
#include "opencl/primitives.hpp"
#include "system.hpp"

namespace broadcl::opencl {
namespace {

/// Any CPU except Mesa's llvmpipe, which in version 22.3 silently ends a work-item after 65,535 iterations of
/// its loops, so that few work-items could not do all the work.
bool wants_few_work_items(const Device& device) {
  return device.type == DeviceType::cpu && device.name.find("llvmpipe") == std::string::npos;
}

/// The largest number of work-items per work-group.
std::size_t largest_group(const cl::Device& device) {
  return std::min(device.getInfo<CL_DEVICE_MAX_WORK_GROUP_SIZE>(),
                  device.getInfo<CL_DEVICE_MAX_WORK_ITEM_SIZES>().front());
}

/// The tuning that the environment names, if any.
std::optional<Tuning> named_tuning() {
  const auto name = environment("BROADCL_TUNING");
  if (!name) return std::nullopt;
  for (const Tuning tuning : {Tuning::gpu, Tuning::gpu64, Tuning::cpu}) {
    if (*name == to_string(tuning)) return tuning;
  }
  throw Error("BROADCL_TUNING is '" + *name + "'; set it to gpu, gpu64 or cpu");
}

bool has_nvidia_vote(const cl::Device& device) {
  // From cl_ext.h, which declares them for other versions of OpenCL only.
  constexpr cl_device_info compute_capability_major = 0x4000;
  constexpr cl_device_info warp_size = 0x4003;
  constexpr cl_uint volta = 7;
  if (environment("BROADCL_TUNING")) return false;
  if (device.getInfo<CL_DEVICE_EXTENSIONS>().find("cl_nv_device_attribute_query") == std::string::npos)
    return false;
  return ask<cl_uint>(device, warp_size) == 32U && ask<cl_uint>(device, compute_capability_major) >= volta;
}

/// Whether this is Intel's own driver (not Mesa's or Apple's) for its GPUs.
bool is_intels_gpu(const Device& device) {
  return device.type == DeviceType::gpu && device.platform_name.starts_with("Intel(R) OpenCL");
}

/// A key for this device and its driver only.
std::string key_of(const Device& device, std::string_view key) {
  std::string result;
  for (const std::string& part : {device.platform_name, device.name, device.version, device.driver_version}) {
    result += part + '\0';
  }
  return result += key;
}

/// Whether the driver has its own cache of compiled programs. PoCL has, and exporting a binary takes it
/// longer than everything else, because it compiles every kernel once more, for work-groups of any size. In
/// that case only a marker is stored in place of the binary, so that on_compile is not called again.
bool keeps_programs(const Device& device) {
  return device.platform_name == "Portable Computing Language";
}

/// Mesa's rusticl 22.3 says of each kernel that it runs in work-groups of up to 32, and that it needs twice
/// the local memory that it does, but runs them in as large work-groups as the device allows. (Version 25.0
/// does not.)
bool misjudges_kernels(const Device& device) {
  return device.platform_name == "rusticl" && device.driver_version.starts_with("22.");
}

/// A program from a cached binary; none if the driver rejects it.
std::optional<cl::Program> from_binary(const cl::Context& context, const cl::Device& device,
                                       const DiskCache::Bytes& binary, const std::string& options) {
  try {
    cl::Program program(context, {device}, {binary});
    program.build(device, options.c_str());
    return program;
  } catch (const cl::Error&) {
    return std::nullopt;
  }
}

}  // namespace

std::string_view to_string(Tuning tuning) noexcept {
  switch (tuning) {
    case Tuning::gpu:
      return "gpu";
    case Tuning::gpu64:
      return "gpu64";
    case Tuning::cpu:
      break;
  }
  return "cpu";
}

Context::Context(Device device, bool profile, CompileHandler on_compile, std::optional<Tuning> tuning)
    : device_(std::move(device)), cl_device_(opencl::open(device_)) {
  programs_->on_compile = std::move(on_compile);
  translate_errors(device_.label(), [&] {
    if (profile && (cl_device_.getInfo<CL_DEVICE_QUEUE_PROPERTIES>() & CL_QUEUE_PROFILING_ENABLE) == 0) {
      throw Error(device_.label() + ": the device has no profiling; do not request it");
    }
    context_ = cl::Context(cl_device_);
    open(cl::CommandQueue(context_, cl_device_, profile ? CL_QUEUE_PROFILING_ENABLE : 0), tuning);
    owns_queue_ = true;
  });
}

Context::Context(const cl::CommandQueue& queue, CompileHandler on_compile, std::optional<Tuning> tuning)
    : device_(describe(queue)) {
  programs_->on_compile = std::move(on_compile);
  translate_errors(device_.label(), [&] {
    if ((queue.getInfo<CL_QUEUE_PROPERTIES>() & CL_QUEUE_OUT_OF_ORDER_EXEC_MODE_ENABLE) != 0) {
      throw Error(device_.label() + ": the queue is out of order; give one that is in order");
    }
    cl_device_ = queue.getInfo<CL_QUEUE_DEVICE>();
    context_ = queue.getInfo<CL_QUEUE_CONTEXT>();
    open(queue, tuning);
  });
}

Context::~Context() {
  if (owns_queue_) wait_if_possible(queue_);
}

Context Context::with_own_memory() const {
  Context context(*this);
  context.owns_queue_ = false;
  context.memory_ = std::make_shared<Memory>();
  context.fill_ = {};  // kernel arguments are not shared
  return context;
}

void Context::open(const cl::CommandQueue& queue, std::optional<Tuning> tuning) {
  queue_ = queue;
  largest_group_ = opencl::largest_group(cl_device_);
  local_memory_ = cl_device_.getInfo<CL_DEVICE_LOCAL_MEM_SIZE>();
  const std::optional<Tuning> named = named_tuning();
  is_tuning_named_ = named.has_value();
  tuning_ = named ? *named : tuning ? *tuning : suitable_tuning();
  has_nvidia_vote_ = opencl::has_nvidia_vote(cl_device_);
  if (flushes_denormals(*this)) options_ += " -DFLUSHES=1";
  if (is_tuning_named_ || device_.host_unified) return;
  create_direct_ = find_direct_memory(cl_device_);
  if (create_direct_ != nullptr && !is_direct_memory_coherent(*this)) create_direct_ = nullptr;
}

Tuning Context::suitable_tuning() const {
  // What kernels that are tuned for GPUs need.
  constexpr std::size_t group = 256;
  constexpr cl_ulong local_memory = 32 << 10;
  if (wants_few_work_items(device_) || largest_group_ < group || local_memory_ < local_memory)
    return Tuning::cpu;
  return has_waves_of_64() ? Tuning::gpu64 : Tuning::gpu;
}

/// Whether a GPU runs 64 work-items in step. (With OpenCL's embedded profile, it may have no 64-bit
/// integers.)
bool Context::has_waves_of_64() const {
  constexpr std::size_t wave = 64;
  if (device_.type != DeviceType::gpu || cl_device_.getInfo<CL_DEVICE_PROFILE>() != "FULL_PROFILE")
    return false;
  const auto extensions = cl_device_.getInfo<CL_DEVICE_EXTENSIONS>();
  // From cl_ext.h, which declares them for other versions of OpenCL only.
  constexpr std::array<std::pair<std::string_view, cl_device_info>, 2> by_extension{
      {{"cl_amd_device_attribute_query", 0x4043}, {"cl_nv_device_attribute_query", 0x4003}}};
  for (const auto& [extension, name] : by_extension) {
    if (extensions.find(extension) == std::string::npos) continue;
    if (const auto width = ask<cl_uint>(cl_device_, name)) return *width == wave;
  }
  const cl::Kernel any(program("arithmetic.cl"), "arithmetic");
  return any.getWorkGroupInfo<CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE>(cl_device_) == wave;
}

/// Work-items per work-group of a kernel, at most.
std::size_t Context::largest_group(const cl::Kernel& kernel) const {
  if (misjudges_kernels(device_)) return largest_group_;
  return std::min(largest_group_, kernel.getWorkGroupInfo<CL_KERNEL_WORK_GROUP_SIZE>(cl_device_));
}

/// Bytes per work-group that a kernel needs.
cl_ulong Context::local_memory(const cl::Kernel& kernel) const {
  return misjudges_kernels(device_) ? 0 : kernel.getWorkGroupInfo<CL_KERNEL_LOCAL_MEM_SIZE>(cl_device_);
}

cl::Kernel Context::kernel(const cl::Program& program, const char* name, std::size_t group) const {
  cl::Kernel kernel(program, name);
  const std::size_t allowed = largest_group(kernel);
  const cl_ulong memory = local_memory(kernel);
  if (allowed >= group && memory <= local_memory_) return kernel;
  const std::string what =
      device_.label() + ": the kernel " + name + " needs " +
      (allowed < group
           ? "work-groups of " + std::to_string(group) + ", but the device allows " + std::to_string(allowed)
           : std::to_string(memory) + " bytes of local memory, but the device has " +
                 std::to_string(local_memory_));
  if (allowed == 0 || group == 1) throw Error(what + "; use another device");
  if (is_tuning_named_) throw Error(what + "; set BROADCL_TUNING=cpu, which uses smaller ones");
  throw GroupTooLarge(what);
}

SizedKernel Context::sized_kernel(const cl::Program& program, const char* name, std::size_t wanted) const {
  cl::Kernel kernel = this->kernel(program, name, 1);
  const std::size_t group = std::bit_floor(std::min(wanted, largest_group(kernel)));
  return {std::move(kernel), group};
}

cl::CommandQueue Context::second_queue() const {
  return {context_, cl_device_, queue_.getInfo<CL_QUEUE_PROPERTIES>()};
}

void Context::fill(const cl::CommandQueue& queue, const cl::Buffer& buffer, cl_uint value, std::size_t first,
                   std::size_t count, cl::Event* event) const {
  if (fill_.kernel() == nullptr) fill_ = sized_kernel(primitives(*this), "fill");
  set_arguments(fill_.kernel, 0, static_cast<cl_uint>(count), value, static_cast<cl_ulong>(first), buffer);
  // A GPU takes longer for work-items that set only one word.
  constexpr std::size_t most_items = std::size_t{1} << 18;
  fill_.enqueue(queue, std::min(count, most_items), event);
}

std::optional<Context::LargeBuffers> Context::large_buffers() const {
  if (!is_intels_gpu(device_)) return std::nullopt;
  return LargeBuffers{.option = " -cl-intel-greater-than-4GB-buffer-required", .most = device_.memory};
}

cl::Buffer Context::create(std::size_t bytes, cl_mem_flags flags) const {
  if (bytes > device_.max_allocation && is_intels_gpu(device_)) {
    constexpr cl_mem_flags allow_unrestricted_size = 1 << 23;  // CL_MEM_ALLOW_UNRESTRICTED_SIZE_INTEL
    flags |= allow_unrestricted_size;
  }
  return {context_, CL_MEM_READ_WRITE | flags, bytes};
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
  return counted(create_direct(create_direct_, context_, bytes), bytes, &Memory::pinned);
}

MemoryUse Context::memory() const noexcept {
  return {.device = memory_->device, .device_peak = memory_->device_peak, .pinned = memory_->pinned};
}

std::optional<DiskCache::Bytes> Context::load(std::string_view key) const {
  return disk_cache_.load(key_of(device_, key));
}

void Context::store(std::string_view key, const DiskCache::Bytes& bytes) const {
  (void)disk_cache_.store(key_of(device_, key), bytes);
}

cl::Program Context::program(std::string_view file, const std::string& options) const {
  const std::string source = kernel_source(file);
  const std::string all_options = options_ + " " + options;
  const std::string key = all_options + '\0' + source;
  const auto known = programs_->built.find(key);
  if (known != programs_->built.end()) return known->second;
  cl::Program program = translate_errors(device_.label(), [&] { return build(file, source, all_options); });
  programs_->built.emplace(key, program);
  return program;
}

cl::Program Context::build(std::string_view file, const std::string& source,
                           const std::string& options) const {
  const std::string key = options + '\0' + source;
  const DiskCache::Bytes binary = load(key).value_or(DiskCache::Bytes());
  const bool is_kept_by_driver = keeps_programs(device_);
  if (!binary.empty() && !is_kept_by_driver) {
    if (auto program = from_binary(context_, cl_device_, binary, options)) return *program;
  }
  if (binary.empty() || !is_kept_by_driver) {
    if (const CompileHandler on_compile = std::exchange(programs_->on_compile, {})) {
      // Whether the binary can be stored there shows by storing an empty one.
      const bool is_stored = disk_cache_.store(key_of(device_, key), {});
      on_compile(device_, is_stored ? disk_cache_.folder().string() : "");
    }
  }
  cl::Program program(context_, source);
  try {
    program.build(cl_device_, options.c_str());
  } catch (const cl::BuildError&) {
    throw Error(device_.label() + ": " + std::string(file) + " does not compile:\n" +
                with_file_names(program.getBuildInfo<CL_PROGRAM_BUILD_LOG>(cl_device_), source));
  }
  if (is_kept_by_driver) {
    if (binary.empty()) store(key, {'1'});
    return program;
  }
  const auto binaries = program.getInfo<CL_PROGRAM_BINARIES>();
  if (binaries.size() == 1 && !binaries.front().empty()) store(key, binaries.front());
  return program;
}

}  // namespace broadcl::opencl
