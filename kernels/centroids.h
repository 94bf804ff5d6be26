/* Centroids of boxes, and their bounds as words that atomics can compare. */
#ifndef BROADCL_CENTROIDS_H
#define BROADCL_CENTROIDS_H

#include "aabb.h"
#include "filter.h"

/* The bucket with the bounds of a world. Worlds may share a bucket, but not with objects of all worlds. `buckets` is
   2^k + 1, or 1 for all objects. */
static inline uint bucket_of_world(const uint world, const uint buckets) {
  if (buckets == 1U) return 0;
  return world == ALL_WORLDS ? buckets - 1U : world & (buckets - 2U);
}

/* Maps floats to numbers in the same order, and back. */
static inline uint ordered(const float value) {
  const uint bits = as_uint(value);
  return (bits >> 31) != 0U ? ~bits : bits | 0x80000000U;
}
static inline float from_ordered(const uint word) {
  return as_float((word >> 31) != 0U ? word & 0x7fffffffU : ~word);
}

/* The centroid of a box; NaN if there is none. */
static inline float3 centroid(global const float* box) {
  const float3 sum = vload3(0, box) * 0.5F + vload3(1, box) * 0.5F;
  return all(fabs(sum) < 1e30F) != 0 ? sum : (float3)(NAN);
}

#endif
