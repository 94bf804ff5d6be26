#include "opencl/error.hpp"

#include <algorithm>
#include <array>

namespace broadcl::opencl {
namespace {

struct Code {
  cl_int value;
  std::string_view name;
  std::string_view remedy;
  ErrorKind kind = ErrorKind::other;
};

constexpr std::string_view memory_remedy = "use fewer boxes, another algorithm or a device with more memory";
constexpr std::string_view lost_remedy =
    "the device was lost: create a new object; if a watchdog ended a kernel that took long, use fewer boxes "
    "or the algorithm tiles";
/// Drivers report both with one code.
constexpr std::string_view resources_remedy =
    "the device has too little memory, or a watchdog ended a kernel that took long: create a new object, and "
    "use fewer boxes, the algorithm tiles or a device with more memory";
constexpr std::string_view driver_remedy = "check this device with `broadcl check`, and update its driver";

constexpr std::array codes{
    Code{CL_DEVICE_NOT_AVAILABLE, "CL_DEVICE_NOT_AVAILABLE", "choose another device"},
    Code{CL_COMPILER_NOT_AVAILABLE, "CL_COMPILER_NOT_AVAILABLE", "choose another device"},
    Code{CL_MEM_OBJECT_ALLOCATION_FAILURE, "CL_MEM_OBJECT_ALLOCATION_FAILURE", memory_remedy,
         ErrorKind::out_of_device_memory},
    Code{CL_OUT_OF_RESOURCES, "CL_OUT_OF_RESOURCES", resources_remedy, ErrorKind::device_lost},
    Code{CL_OUT_OF_HOST_MEMORY, "CL_OUT_OF_HOST_MEMORY", memory_remedy, ErrorKind::out_of_device_memory},
    Code{CL_INVALID_BUFFER_SIZE, "CL_INVALID_BUFFER_SIZE", memory_remedy, ErrorKind::out_of_device_memory},
    Code{CL_MAP_FAILURE, "CL_MAP_FAILURE", memory_remedy, ErrorKind::out_of_device_memory},
    Code{CL_BUILD_PROGRAM_FAILURE, "CL_BUILD_PROGRAM_FAILURE", driver_remedy},
    Code{CL_INVALID_BINARY, "CL_INVALID_BINARY", driver_remedy},
    Code{CL_INVALID_WORK_GROUP_SIZE, "CL_INVALID_WORK_GROUP_SIZE", driver_remedy},
    Code{CL_INVALID_COMMAND_QUEUE, "CL_INVALID_COMMAND_QUEUE", lost_remedy, ErrorKind::device_lost},
    Code{CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST, "CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST",
         lost_remedy, ErrorKind::device_lost},
    Code{no_platform, "CL_PLATFORM_NOT_FOUND_KHR",
         "install OpenCL's loader, libOpenCL.so.1 (Debian, Ubuntu: apt install ocl-icd-libopencl1)"},
};

const Code* row_of(cl_int code) {
  const auto* row = std::find_if(codes.begin(), codes.end(), [&](const Code& c) { return c.value == code; });
  return row == codes.end() ? nullptr : row;
}

}  // namespace

std::string code_name(cl_int code) {
  const Code* row = row_of(code);
  return (row != nullptr ? std::string(row->name) + " " : "OpenCL error ") + "(" + std::to_string(code) + ")";
}

Error to_error(const cl::Error& error, std::string_view device) {
  const Code* row = row_of(error.err());
  return Error(std::string(device) + ": " + error.what() + " failed with " + code_name(error.err()) + "; " +
                   std::string(row != nullptr ? row->remedy : driver_remedy),
               row != nullptr ? row->kind : ErrorKind::device_lost);
}

}  // namespace broadcl::opencl
