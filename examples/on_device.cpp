// Boxes that a program already has on the device: pairs are found there and stay there.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <broadcl/aabb.hpp>
#include <broadcl/opencl.hpp>

namespace {

void check(cl_int code, const char* call) {
  if (code == CL_SUCCESS) return;
  std::fprintf(stderr, "%s failed with %d\n", call, code);
  std::exit(1);
}

/// The first device of the first platform that has one.
cl_device_id first_device() {
  std::vector<cl_platform_id> platforms(16);
  cl_uint count = 0;
  check(clGetPlatformIDs(16, platforms.data(), &count), "clGetPlatformIDs");
  for (cl_uint k = 0; k < std::min(count, 16U); ++k) {
    cl_device_id device = nullptr;
    if (clGetDeviceIDs(platforms[k], CL_DEVICE_TYPE_ALL, 1, &device, nullptr) == CL_SUCCESS) return device;
  }
  std::fprintf(stderr, "no OpenCL device\n");
  std::exit(1);
}

}  // namespace

int main() {
  cl_device_id device = first_device();
  cl_int code = CL_SUCCESS;
  cl_context context = clCreateContext(nullptr, 1, &device, nullptr, nullptr, &code);
  check(code, "clCreateContext");
  cl_command_queue queue = clCreateCommandQueue(context, device, 0, &code);
  check(code, "clCreateCommandQueue");

  // A row of boxes, each of which overlaps the next.
  std::vector<broadcl::Aabb> boxes;
  for (int k = 0; k < 1000; ++k) {
    const auto x = static_cast<float>(k);
    boxes.push_back({{x, 0, 0}, {x + 1.5F, 1, 1}});
  }
  cl_mem buffer = clCreateBuffer(context, CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR,
                                 boxes.size() * sizeof(broadcl::Aabb), boxes.data(), &code);
  check(code, "clCreateBuffer");
  {
    // [device]
    broadcl::DeviceBroadPhase broad_phase(queue);
    const auto result = broad_phase.update({.buffer = buffer, .count = boxes.size()});
    // The program's own kernel would read result.added.buffer now, in the same queue.
    std::printf("%s: %zu boxes, %zu pairs, %zu of them new\n", broad_phase.device().name.c_str(),
                boxes.size(), result.pair_count, result.added.count);
    // [device]
  }
  check(clFinish(queue), "clFinish");  // some drivers crash if the process ends before the queue does
  clReleaseMemObject(buffer);
  clReleaseCommandQueue(queue);
  clReleaseContext(context);
}
