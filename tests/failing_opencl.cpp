#include "failing_opencl.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "device_limits.hpp"
#include "opencl/api.hpp"
#include "opencl/direct_memory.hpp"
#include "opencl/error.hpp"

namespace broadcl::test {
namespace {

constexpr long no_call = std::numeric_limits<long>::max();
std::atomic<long> calls_made = 0;
std::atomic<long> first_failing = no_call;
std::atomic<long> first_succeeding = no_call;

std::atomic<const char*> last_name = "";  // of those that failed
std::atomic<cl_command_queue> last_queue = nullptr;
std::atomic<long> blocking_calls = 0;
std::atomic<long> memory_references = 0;
std::atomic<long> programs_built = 0;
std::atomic<long> programs_being_built = 0;
std::atomic<long> most_built_at_once = 0;
std::atomic<long> commands_without_event = 0;
std::atomic<long> mapped_regions = 0;
std::atomic<long> transfers = 0;
std::mutex launches_mutex;
std::map<std::string, long> launches;  // by the kernel's name

constinit thread_local int depth = 0;  // of OpenCL calls

struct Inside {
  Inside() { ++depth; }
  ~Inside() { --depth; }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
  Inside(Inside&&) = delete;
  Inside& operator=(Inside&&) = delete;
};

/// Calls the function that this program would call if this file did not define one of that name.
template <class Function, class... Arguments>
auto call_next(Function* /*type*/, const char* name, Arguments... arguments) {
  const Inside inside;
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name))(arguments...);
}

/// Calls inside other calls never fail.
bool fails() {
  if (depth > 0) return false;
  const long call = calls_made++;
  return call >= first_failing && call < first_succeeding;
}

/// A failed device does nothing more, so its earlier commands are completed first.
void drain(cl_command_queue queue) {
  cl_event end = nullptr;
  call_next(clEnqueueMarkerWithWaitList, "clEnqueueMarkerWithWaitList", queue, cl_uint{0},
            static_cast<const cl_event*>(nullptr), &end);
  call_next(clWaitForEvents, "clWaitForEvents", cl_uint{1}, static_cast<const cl_event*>(&end));
  call_next(clReleaseEvent, "clReleaseEvent", end);
}

void count_launch(cl_kernel kernel) {
  const Inside inside;
  const auto name = cl::Kernel(kernel, true).getInfo<CL_KERNEL_FUNCTION_NAME>();
  const std::lock_guard lock(launches_mutex);
  ++launches[name];
}

void begin_building() {
  const long now = ++programs_being_built;
  for (long most = most_built_at_once; now > most && !most_built_at_once.compare_exchange_weak(most, now);) {
  }
}

std::atomic<opencl::CreateDirect> real_create_direct = nullptr;

/// In place of NVIDIA's clCreateBufferNV; also where there is none.
cl_mem CL_API_CALL create_direct(cl_context context, cl_mem_flags flags, cl_bitfield nvidias_flags,
                                 std::size_t bytes, void* host, cl_int* error) {
  if (fails()) {
    last_name = "clCreateBufferNV";
    *error = CL_OUT_OF_RESOURCES;
    return nullptr;
  }
  const Inside inside;
  const opencl::CreateDirect real = real_create_direct;
  if (real != nullptr && !is_direct_memory_copied()) {
    auto* const buffer = real(context, flags, nvidias_flags, bytes, host, error);
    memory_references += buffer != nullptr ? 1 : 0;
    return buffer;
  }
  auto* const buffer = clCreateBuffer(context, flags | CL_MEM_ALLOC_HOST_PTR, bytes, host, error);
  if (is_direct_memory_copied()) set_apart(buffer, bytes);
  return buffer;
}

/// The name of a function, as an argument of a template.
template <std::size_t n>
struct Name {
  // NOLINTNEXTLINE(modernize-avoid-c-arrays): the argument is a literal
  constexpr Name(const char (&name)[n]) { std::copy_n(name, n, text.begin()); }
  [[nodiscard]] constexpr std::string_view view() const { return {text.data(), n - 1}; }
  std::array<char, n> text{};
};

/// This program calls it instead of an OpenCL function.
template <Name name, class Function>
struct Watched;

template <Name name, class Result, class... Arguments>
struct Watched<name, Result(Arguments...)> {
  static Result call(Arguments... arguments) {
    const std::tuple<Arguments...> all(arguments...);
    if (blocks(all)) ++blocking_calls;
    if constexpr (is_timed) {
      if (std::get<sizeof...(Arguments) - 1>(all) == nullptr) ++commands_without_event;
    }
    if constexpr (text.starts_with("clEnqueue")) last_queue = std::get<0>(all);
    if (!is_reference && fails()) return failure(all, CL_OUT_OF_RESOURCES);
    if (const cl_int error = refusal(all); error != CL_SUCCESS) return failure(all, error);
    if constexpr (text == "clGetDeviceInfo" || text == "clGetPlatformInfo") {
      if (is_answered(std::get<1>(all), std::get<2>(all), std::get<3>(all), std::get<4>(all)))
        return CL_SUCCESS;
    }
    if constexpr (text == "clGetKernelWorkGroupInfo") {
      if (is_answered(std::get<2>(all), std::get<3>(all), std::get<4>(all), std::get<5>(all)))
        return CL_SUCCESS;
    }
    if constexpr (text == "clEnqueueMapBuffer" || text == "clEnqueueUnmapMemObject") {
      if (void* const memory = memory_apart(std::get<1>(all))) {
        if constexpr (text == "clEnqueueMapBuffer") *std::get<9>(all) = CL_SUCCESS;
        return count_mapping(memory);
      }
    }
    if constexpr (text == "clBuildProgram") begin_building();
    const Result result = call_limited(all);
    if constexpr (text == "clBuildProgram") --programs_being_built;
    if constexpr (text == "clGetExtensionFunctionAddressForPlatform") {
      if (std::string_view(std::get<1>(all)) != "clCreateBufferNV") return result;
      real_create_direct = reinterpret_cast<opencl::CreateDirect>(result);
      return has_direct_memory(result != nullptr) ? reinterpret_cast<Result>(create_direct) : nullptr;
    }
    count(result);
    if constexpr (text == "clEnqueueNDRangeKernel") count_launch(std::get<1>(all));
    if constexpr (text == "clCreateBuffer") note_buffer(result, std::get<2>(all));
    if constexpr (text == "clCreateKernel") note_kernel(result, std::get<0>(all));
    limit(all);
    return result;
  }

 private:
  using All = std::tuple<Arguments...>;
  static constexpr std::string_view text = name.view();
  static constexpr bool is_reference = text.starts_with("clRetain") || text.starts_with("clRelease");
  static constexpr bool always_blocks = text == "clFinish" || text == "clWaitForEvents";
  static constexpr bool is_timed = text == "clEnqueueNDRangeKernel" || text == "clEnqueueCopyBuffer" ||
                                   text == "clEnqueueFillBuffer" || text == "clEnqueueReadBuffer" ||
                                   text == "clEnqueueWriteBuffer";
  static constexpr bool may_block = text.starts_with("clEnqueueRead") || text.starts_with("clEnqueueWrite") ||
                                    text.starts_with("clEnqueueMap");

  static bool blocks(const All& all) {
    if constexpr (may_block) return std::get<2>(all) == CL_TRUE;
    return always_blocks;
  }

  /// Counts the mapping of memory that OpenCL does not know, or its end.
  static Result count_mapping(void* memory) {
    Result result{};
    if constexpr (text == "clEnqueueMapBuffer") result = memory;
    count(result);
    return result;
  }

  static Result call_limited(All all) {
    std::string options;
    if constexpr (text == "clBuildProgram") {
      options = limited_options(std::get<0>(all), std::get<3>(all));
      std::get<3>(all) = options.c_str();
    }
    if constexpr (text == "clCreateBuffer") std::get<1>(all) = known_flags(std::get<1>(all));
    return std::apply(
        [](Arguments... arguments) {
          return call_next(static_cast<Result (*)(Arguments...)>(nullptr), name.text.data(), arguments...);
        },
        all);
  }

  /// The error of a call that exceeds the current limits, or CL_SUCCESS.
  static cl_int refusal(const All& all) {
    const Inside inside;
    if constexpr (text == "clGetDeviceIDs") return refusal_of_devices();
    if constexpr (text == "clEnqueueNDRangeKernel")
      return refusal_of_launch(std::get<1>(all), std::get<2>(all), std::get<5>(all));
    if constexpr (text == "clCreateBuffer") return refusal_of_buffer(std::get<1>(all), std::get<2>(all));
    if constexpr (text == "clSetKernelArg")
      return refusal_of_argument(std::get<0>(all), std::get<2>(all), std::get<3>(all));
    if constexpr (text == "clCreateCommandQueue") return refusal_of_queue(std::get<2>(all));
    return CL_SUCCESS;
  }

  /// Changes an answer to that of a device with these limits.
  static void limit(const All& all) {
    const Inside inside;
    if constexpr (text == "clGetPlatformIDs")
      list_twice(std::get<0>(all), std::get<1>(all), std::get<2>(all));
    if constexpr (text == "clGetDeviceInfo")
      limit_device_info(std::get<1>(all), std::get<2>(all), std::get<3>(all));
    if constexpr (text == "clGetKernelWorkGroupInfo")
      limit_kernel_info(std::get<0>(all), std::get<2>(all), std::get<3>(all), std::get<4>(all));
  }

  static Result failure(const All& all, cl_int code) {
    last_name = name.text.data();
    using First = std::tuple_element_t<0, All>;
    if constexpr (std::is_same_v<First, cl_command_queue>) drain(std::get<0>(all));
    if constexpr (text == "clWaitForEvents") std::apply(waits, all);
    if constexpr (text == "clGetExtensionFunctionAddressForPlatform") {
      return nullptr;
    } else if constexpr (std::is_pointer_v<Result>) {
      cl_int* const error = std::get<sizeof...(Arguments) - 1>(all);
      if (error != nullptr) *error = code;
      return nullptr;
    } else {
      return code;
    }
  }
  static void waits(Arguments... arguments) { call_next(clWaitForEvents, "clWaitForEvents", arguments...); }

  static void count(const Result& result) {
    if constexpr (text == "clCreateBuffer") memory_references += result != nullptr ? 1 : 0;
    if constexpr (text == "clRetainMemObject") memory_references += result == CL_SUCCESS ? 1 : 0;
    if constexpr (text == "clReleaseMemObject") memory_references -= result == CL_SUCCESS ? 1 : 0;
    if constexpr (text == "clBuildProgram") programs_built += result == CL_SUCCESS ? 1 : 0;
    if constexpr (text == "clEnqueueReadBuffer" || text == "clEnqueueWriteBuffer") ++transfers;
    if constexpr (text == "clEnqueueMapBuffer") mapped_regions += result != nullptr ? 1 : 0;
    if constexpr (text == "clEnqueueUnmapMemObject") mapped_regions -= result == CL_SUCCESS ? 1 : 0;
  }
};

}  // namespace

FailingOpenCl::FailingOpenCl(long first, long count) {
  opencl::forget_opened_devices();  // so that objects that are created open the device by calls that can fail
  calls_made = 0;
  first_succeeding = first > no_call - count ? no_call : first + count;
  first_failing = first;
}

FailingOpenCl::~FailingOpenCl() {
  first_failing = no_call;
}

long FailingOpenCl::calls() noexcept {
  return calls_made;
}

std::string_view FailingOpenCl::last_failed() noexcept {
  return last_name.load();
}

OpenClUse opencl_use() noexcept {
  return {.blocking_calls = blocking_calls,
          .memory_references = memory_references,
          .mapped_regions = mapped_regions,
          .programs_built = programs_built,
          .most_built_at_once = most_built_at_once,
          .commands_without_event = commands_without_event,
          .transfers = transfers};
}

long launches_of(std::string_view kernel) {
  const std::lock_guard lock(launches_mutex);
  long count = 0;
  for (const auto& [name, times] : launches) count += name.starts_with(kernel) ? times : 0;
  return count;
}

void wait_for_last_queue() {
  if (last_queue != nullptr) drain(last_queue);
}

bool is_inside_opencl() noexcept {
  return depth > 0;
}

}  // namespace broadcl::test

// Each precedes the loader's function of the same name, since a program's own symbols come first. The linker
// calls a function to resolve the symbol (before sanitizers are ready), so no list of parameters needs to be
// repeated. Hidden, so that Oclgrind, which is loaded with the program, calls its own functions.
// NOLINTBEGIN(bugprone-macro-parentheses): names in declarations take none
#define WATCH(function)                                                                           \
  __attribute__((no_sanitize("address", "undefined"))) decltype(function)* watched_##function() { \
    return &broadcl::test::Watched<#function, decltype(function)>::call;                          \
  }                                                                                               \
  decltype(function) function __attribute__((ifunc("watched_" #function), visibility("hidden")))
// NOLINTEND(bugprone-macro-parentheses)

// All functions that the library and these tests call; opencl-calls-are-watched fails if one is missing.
extern "C" {
WATCH(clBuildProgram);
WATCH(clCreateBuffer);
WATCH(clCreateCommandQueue);
WATCH(clCreateContext);
WATCH(clCreateKernel);
WATCH(clCreateProgramWithBinary);
WATCH(clCreateProgramWithSource);
WATCH(clCreateUserEvent);
WATCH(clEnqueueBarrierWithWaitList);
WATCH(clEnqueueCopyBuffer);
WATCH(clEnqueueFillBuffer);
WATCH(clEnqueueMapBuffer);
WATCH(clEnqueueMarkerWithWaitList);
WATCH(clEnqueueNDRangeKernel);
WATCH(clEnqueueReadBuffer);
WATCH(clEnqueueUnmapMemObject);
WATCH(clEnqueueWriteBuffer);
WATCH(clFinish);
WATCH(clFlush);
WATCH(clGetCommandQueueInfo);
WATCH(clGetContextInfo);
WATCH(clGetDeviceIDs);
WATCH(clGetDeviceInfo);
WATCH(clGetEventInfo);
WATCH(clGetEventProfilingInfo);
WATCH(clGetExtensionFunctionAddressForPlatform);
WATCH(clGetKernelInfo);
WATCH(clGetKernelWorkGroupInfo);
WATCH(clGetMemObjectInfo);
WATCH(clGetPlatformIDs);
WATCH(clGetPlatformInfo);
WATCH(clGetProgramBuildInfo);
WATCH(clGetProgramInfo);
WATCH(clReleaseCommandQueue);
WATCH(clReleaseContext);
WATCH(clReleaseDevice);
WATCH(clReleaseEvent);
WATCH(clReleaseKernel);
WATCH(clReleaseMemObject);
WATCH(clReleaseProgram);
WATCH(clRetainCommandQueue);
WATCH(clRetainContext);
WATCH(clRetainDevice);
WATCH(clRetainEvent);
WATCH(clRetainKernel);
WATCH(clRetainMemObject);
WATCH(clRetainProgram);
WATCH(clSetEventCallback);
WATCH(clSetKernelArg);
WATCH(clSetMemObjectDestructorCallback);
WATCH(clSetUserEventStatus);
WATCH(clWaitForEvents);
}
