/* Centroids of boxes, and their bounds as words that atomics can compare. */
#ifndef BROADCL_CENTROIDS_H
#define BROADCL_CENTROIDS_H

#include "aabb.h"

/* Numbers in the order of floats. */
static inline uint ordered(const float value) {
  const uint bits = as_uint(value);
  return (bits >> 31) != 0U ? ~bits : bits | 0x80000000U;
}
static inline float from_ordered(const uint word) {
  return as_float((word >> 31) != 0U ? word & 0x7fffffffU : ~word);
}

/* The centroid of a box; not finite where that makes no sense. */
static inline float3 centroid(global const float* box) {
  const float3 sum = vload3(0, box) * 0.5F + vload3(1, box) * 0.5F;
  return all(fabs(sum) < 1e30F) != 0 ? sum : (float3)(NAN);
}

#endif
