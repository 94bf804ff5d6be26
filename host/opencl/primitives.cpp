#include "opencl/primitives.hpp"

#include <string>

namespace broadcl::opencl {

cl::Program primitives(const Context& context) {
  return context.program("primitives.cl", "-DGROUP=" + std::to_string(primitives_group(context)) +
                                              " -DTILE=" + std::to_string(sort_tile) +
                                              " -DDIGIT_BITS=" + std::to_string(digit_bits));
}

}  // namespace broadcl::opencl
