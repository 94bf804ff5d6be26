/* Objects of the caller, in the caller's layout. */
#ifndef BROADCL_GATHER_H
#define BROADCL_GATHER_H

#include "aabb.h"
#include "delta.h"

/* Boxes, the first of which begins at `offset` and each further one `stride` floats later; filters, null if there are
   none; where to copy both; and where to count. If there are two sets, objects from `first_count` on belong to the
   second set, and the sets determine the groups and masks. */
#define GATHER_PARAMETERS GATHER_PARAMETERS_OF(restrict)
/* (No `restrict` in functions: Oclgrind 21.10 does not know what remains of it after inlining.) */
#define GATHER_PARAMETERS_OF(restrict_)                                                                   \
  global const float *restrict_ source, const ulong offset, const ulong stride, const uint first_count,   \
      global const float *restrict_ second, const ulong second_offset, const ulong second_stride,         \
      global const uint4 *restrict_ source_filters, global float *restrict_ boxes, global uint4 *filters, \
      global uint *restrict_ counts

/* Copies object k. An empty box becomes NaNs, as in packed boxes; a box with a NaN bound is counted. */
static inline void gather_object(box_t* box, const uint k, GATHER_PARAMETERS_OF()) {
  make_empty(box);
  if (is_halted(counts)) return;
  const bool is_second = k >= first_count;
  if (filters != 0) {
    uint4 filter = source_filters != 0 ? source_filters[k] : (uint4)(0, 0, NO_BODY, 0);
    if (second != 0) {
      filter.x = is_second ? 2 : 1;
      filter.y = is_second ? 1 : 2;
    }
    filters[k] = filter;
  }
  global const float* p =
      is_second ? second + second_offset + (k - first_count) * second_stride : source + offset + k * stride;
  for (uint i = 0; i < AABB_FLOATS; ++i) box->bound[i] = p[i];
  if (!is_proper(box)) {
    bool has_nan = false;
    for (uint i = 0; i < AABB_FLOATS; ++i) has_nan = has_nan || isnan(box->bound[i]) != 0;
    if (has_nan) {
      atomic_inc(&counts[COUNT_INVALID]);
      atomic_max(&counts[COUNT_INVALID_FIRST], UINT_MAX - k);
    }
    make_empty(box);
  }
  for (uint i = 0; i < AABB_FLOATS; ++i) boxes[(size_t)k * AABB_FLOATS + i] = box->bound[i];
}

#endif
