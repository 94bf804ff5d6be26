#include "failing_opencl.hpp"

#include <dlfcn.h>

#include <atomic>
#include <limits>

#include "opencl/api.hpp"

namespace broadcl::test {
namespace {

constexpr long never = std::numeric_limits<long>::max();
std::atomic<long> calls_made = 0;
std::atomic<long> first_failing = never;
std::atomic<long> first_succeeding = never;

bool fails() {
  const long call = calls_made++;
  return call >= first_failing && call < first_succeeding;
}

/// Calls the function that this program would call without the one of the same name here.
template <class Function, class... Arguments>
auto call_next(Function* /*type*/, const char* name, Arguments... arguments) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name))(arguments...);
}

/// A device that has failed does nothing any more, so what it was given before is done first.
cl_int end_of(cl_command_queue queue) {
  cl_event end = nullptr;
  call_next(clEnqueueMarkerWithWaitList, "clEnqueueMarkerWithWaitList", queue, cl_uint{0},
            static_cast<const cl_event*>(nullptr), &end);
  call_next(clWaitForEvents, "clWaitForEvents", cl_uint{1}, static_cast<const cl_event*>(&end));
  clReleaseEvent(end);
  return CL_OUT_OF_RESOURCES;
}

}  // namespace

FailingOpenCl::FailingOpenCl(long first, long count) {
  calls_made = 0;
  first_succeeding = count > never - first ? never : first + count;
  first_failing = first;
}

FailingOpenCl::~FailingOpenCl() {
  first_failing = never;
}

long FailingOpenCl::calls() noexcept {
  return calls_made;
}

}  // namespace broadcl::test

using broadcl::test::call_next;
using broadcl::test::end_of;
using broadcl::test::fails;

// Each stands before the loader's function of the same name, since a program's own symbols come first.
extern "C" {

cl_mem clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size, void* host, cl_int* error) {
  if (fails()) {
    if (error != nullptr) *error = CL_OUT_OF_RESOURCES;
    return nullptr;
  }
  return call_next(clCreateBuffer, "clCreateBuffer", context, flags, size, host, error);
}

cl_int clSetKernelArg(cl_kernel kernel, cl_uint index, size_t size, const void* value) {
  if (fails()) return CL_OUT_OF_RESOURCES;
  return call_next(clSetKernelArg, "clSetKernelArg", kernel, index, size, value);
}

cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions,
                              const size_t* offset, const size_t* global, const size_t* local, cl_uint count,
                              const cl_event* events, cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueNDRangeKernel, "clEnqueueNDRangeKernel", queue, kernel, dimensions, offset,
                   global, local, count, events, event);
}

cl_int clEnqueueReadBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset,
                           size_t size, void* host, cl_uint count, const cl_event* events, cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueReadBuffer, "clEnqueueReadBuffer", queue, buffer, blocking, offset, size, host,
                   count, events, event);
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset,
                            size_t size, const void* host, cl_uint count, const cl_event* events,
                            cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueWriteBuffer, "clEnqueueWriteBuffer", queue, buffer, blocking, offset, size, host,
                   count, events, event);
}

cl_int clEnqueueCopyBuffer(cl_command_queue queue, cl_mem from, cl_mem to, size_t from_offset,
                           size_t to_offset, size_t size, cl_uint count, const cl_event* events,
                           cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueCopyBuffer, "clEnqueueCopyBuffer", queue, from, to, from_offset, to_offset, size,
                   count, events, event);
}

cl_int clEnqueueFillBuffer(cl_command_queue queue, cl_mem buffer, const void* pattern, size_t pattern_size,
                           size_t offset, size_t size, cl_uint count, const cl_event* events,
                           cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueFillBuffer, "clEnqueueFillBuffer", queue, buffer, pattern, pattern_size, offset,
                   size, count, events, event);
}

void* clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags,
                         size_t offset, size_t size, cl_uint count, const cl_event* events, cl_event* event,
                         cl_int* error) {
  if (fails()) {
    const cl_int code = end_of(queue);
    if (error != nullptr) *error = code;
    return nullptr;
  }
  return call_next(clEnqueueMapBuffer, "clEnqueueMapBuffer", queue, buffer, blocking, flags, offset, size,
                   count, events, event, error);
}

cl_int clEnqueueUnmapMemObject(cl_command_queue queue, cl_mem buffer, void* host, cl_uint count,
                               const cl_event* events, cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueUnmapMemObject, "clEnqueueUnmapMemObject", queue, buffer, host, count, events,
                   event);
}

cl_int clFlush(cl_command_queue queue) {
  if (fails()) return end_of(queue);
  return call_next(clFlush, "clFlush", queue);
}

cl_int clEnqueueMarkerWithWaitList(cl_command_queue queue, cl_uint count, const cl_event* events,
                                   cl_event* event) {
  if (fails()) return end_of(queue);
  return call_next(clEnqueueMarkerWithWaitList, "clEnqueueMarkerWithWaitList", queue, count, events, event);
}

cl_int clWaitForEvents(cl_uint count, const cl_event* events) {
  const bool is_to_fail = fails();
  const cl_int code = call_next(clWaitForEvents, "clWaitForEvents", count, events);
  return is_to_fail ? CL_OUT_OF_RESOURCES : code;
}

}  // extern "C"
