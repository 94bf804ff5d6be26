#include "opencl/common_program.hpp"

#include <string>

namespace broadcl::opencl {

cl::Program common_program(const Context& context) {
  return context.program("common.cl", "-DGROUP=" + std::to_string(context.launch().group) +
                                          " -DDIGIT_BITS=" + std::to_string(digit_bits));
}

}  // namespace broadcl::opencl
