/* What arithmetic.cl finds out about a device, one bit each. Valid OpenCL C and C++. */
#ifndef BROADCL_ARITHMETIC_H
#define BROADCL_ARITHMETIC_H

enum {
  HAS_DENORMALS = 1,
  HAS_ZEROS = 2,
  HAS_INFINITIES = 4,
  HAS_NANS = 8,
  HAS_SIGNS = 16,
  HAS_NEEDED = HAS_ZEROS | HAS_INFINITIES | HAS_NANS | HAS_SIGNS /* without these, pairs would be wrong */
};

#endif
