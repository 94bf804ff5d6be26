/// The functions of OpenCL that this library calls, for programs that start without OpenCL: each opens the
/// system's loader when it is first called. Built if BROADCL_OPEN_OPENCL is on.

#include <dlfcn.h>

#include <cstddef>
#include <tuple>
#include <type_traits>

#include "opencl/api.hpp"

namespace {

/// Opened once, by the first thread that needs it, and never closed, because drivers start their own threads.
void* library() noexcept {
  static void* const handle = dlopen("libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
  return handle;
}

void* find(const char* name) noexcept {
  return library() == nullptr ? nullptr : dlsym(library(), name);
}

template <class Function>
struct Signature;
template <class Result_, class... Arguments>
struct Signature<Result_(Arguments...)> {
  using Result = Result_;
  template <std::size_t index>
  using Argument = std::tuple_element_t<index, std::tuple<Arguments...>>;

  /// Before a platform is found only clGetPlatformIDs is called, or what retains a caller's object.
  static Result call(void* function, Arguments... arguments) {
    if (function != nullptr) return reinterpret_cast<Result (*)(Arguments...)>(function)(arguments...);
    if constexpr (std::is_same_v<Result, cl_int>) {
      return broadcl::opencl::no_platform;
    } else {
      return Result();
    }
  }
};

}  // namespace

// Define a function with this many parameters, whose types are those of <CL/cl.h>.
#define P(name, index) Signature<decltype(::name)>::Argument<index> p##index
#define FORWARD(name, parameters, ...)                               \
  extern "C" Signature<decltype(::name)>::Result name parameters {   \
    static void* const function = find(#name);                       \
    return Signature<decltype(::name)>::call(function, __VA_ARGS__); \
  }
#define FORWARD_1(name) FORWARD(name, (P(name, 0)), p0)
#define FORWARD_2(name) FORWARD(name, (P(name, 0), P(name, 1)), p0, p1)
#define FORWARD_3(name) FORWARD(name, (P(name, 0), P(name, 1), P(name, 2)), p0, p1, p2)
#define FORWARD_4(name) FORWARD(name, (P(name, 0), P(name, 1), P(name, 2), P(name, 3)), p0, p1, p2, p3)
#define FORWARD_5(name) \
  FORWARD(name, (P(name, 0), P(name, 1), P(name, 2), P(name, 3), P(name, 4)), p0, p1, p2, p3, p4)
#define FORWARD_6(name)                                                                                   \
  FORWARD(name, (P(name, 0), P(name, 1), P(name, 2), P(name, 3), P(name, 4), P(name, 5)), p0, p1, p2, p3, \
          p4, p5)
#define FORWARD_7(name)                                                                                   \
  FORWARD(name, (P(name, 0), P(name, 1), P(name, 2), P(name, 3), P(name, 4), P(name, 5), P(name, 6)), p0, \
          p1, p2, p3, p4, p5, p6)
#define FORWARD_9(name)                                                                                    \
  FORWARD(name,                                                                                            \
          (P(name, 0), P(name, 1), P(name, 2), P(name, 3), P(name, 4), P(name, 5), P(name, 6), P(name, 7), \
           P(name, 8)),                                                                                    \
          p0, p1, p2, p3, p4, p5, p6, p7, p8)
#define FORWARD_10(name)                                                                                   \
  FORWARD(name,                                                                                            \
          (P(name, 0), P(name, 1), P(name, 2), P(name, 3), P(name, 4), P(name, 5), P(name, 6), P(name, 7), \
           P(name, 8), P(name, 9)),                                                                        \
          p0, p1, p2, p3, p4, p5, p6, p7, p8, p9)

FORWARD_1(clFinish)
FORWARD_1(clFlush)
FORWARD_1(clReleaseCommandQueue)
FORWARD_1(clReleaseContext)
FORWARD_1(clReleaseDevice)
FORWARD_1(clReleaseEvent)
FORWARD_1(clReleaseKernel)
FORWARD_1(clReleaseMemObject)
FORWARD_1(clReleaseProgram)
FORWARD_1(clRetainCommandQueue)
FORWARD_1(clRetainContext)
FORWARD_1(clRetainDevice)
FORWARD_1(clRetainEvent)
FORWARD_1(clRetainKernel)
FORWARD_1(clRetainMemObject)
FORWARD_1(clRetainProgram)
FORWARD_2(clGetExtensionFunctionAddressForPlatform)
FORWARD_2(clWaitForEvents)
FORWARD_3(clCreateKernel)
FORWARD_3(clGetPlatformIDs)
FORWARD_3(clSetMemObjectDestructorCallback)
FORWARD_4(clCreateCommandQueue)
FORWARD_4(clEnqueueBarrierWithWaitList)
FORWARD_4(clEnqueueMarkerWithWaitList)
FORWARD_4(clSetKernelArg)
FORWARD_5(clCreateBuffer)
FORWARD_5(clCreateProgramWithSource)
FORWARD_5(clGetCommandQueueInfo)
FORWARD_5(clGetDeviceIDs)
FORWARD_5(clGetDeviceInfo)
FORWARD_5(clGetEventProfilingInfo)
FORWARD_5(clGetMemObjectInfo)
FORWARD_5(clGetPlatformInfo)
FORWARD_5(clGetProgramInfo)
FORWARD_6(clBuildProgram)
FORWARD_6(clCreateContext)
FORWARD_6(clEnqueueUnmapMemObject)
FORWARD_6(clGetKernelWorkGroupInfo)
FORWARD_6(clGetProgramBuildInfo)
FORWARD_7(clCreateProgramWithBinary)
FORWARD_9(clEnqueueCopyBuffer)
FORWARD_9(clEnqueueNDRangeKernel)
FORWARD_9(clEnqueueReadBuffer)
FORWARD_9(clEnqueueWriteBuffer)
FORWARD_10(clEnqueueMapBuffer)
