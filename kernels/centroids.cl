/* The reduction of boxes to the bounds of their centroids. Boxes without a centroid are ignored. */

#include "centroids.h"

#if WORLDS
/* Merges into the bounds of a world. */
static inline void merge(const uint lower[3], const uint upper[3], const uint bucket, const uint buckets,
                         global uint* result) {
  for (uint i = 0; i < 3U; ++i) {
    atomic_min(&result[3U * bucket + i], lower[i]);
    atomic_max(&result[3U * (buckets + bucket) + i], upper[i]);
  }
}
#endif

/* The bounds of the centroids: three minima for each bucket of worlds, then three maxima for each, as ordered() makes
   them. Without worlds there is one bucket. */
kernel void centroids(const uint n, global const float* restrict boxes, global const uint4* restrict filters,
                      const uint buckets, global uint* restrict result) {
  uint lower[3] = {0xffffffffU, 0xffffffffU, 0xffffffffU};
  uint upper[3] = {0, 0, 0};
#if WORLDS
  uint bucket = 0;
#endif
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const float3 m = centroid(boxes + (size_t)k * AABB_FLOATS);
    if (isnan(m.x)) continue;
#if WORLDS
    const uint other = bucket_of_world(filters[k].w, buckets);
    if (other != bucket) {
      if (lower[0] <= upper[0]) merge(lower, upper, bucket, buckets, result);
      for (uint i = 0; i < 3U; ++i) {
        lower[i] = 0xffffffffU;
        upper[i] = 0;
      }
      bucket = other;
    }
#endif
    const uint words[3] = {ordered(m.x), ordered(m.y), ordered(m.z)};
    for (uint i = 0; i < 3U; ++i) {
      lower[i] = min(lower[i], words[i]);
      upper[i] = max(upper[i], words[i]);
    }
  }
#if WORLDS
  if (lower[0] <= upper[0]) merge(lower, upper, bucket, buckets, result);
#else
  (void)filters;
  (void)buckets;
  local uint all_lower[3];
  local uint all_upper[3];
  if (get_local_id(0) == 0) {
    for (uint i = 0; i < 3U; ++i) {
      all_lower[i] = 0xffffffffU;
      all_upper[i] = 0;
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = 0; i < 3U; ++i) {
    atomic_min(&all_lower[i], lower[i]);
    atomic_max(&all_upper[i], upper[i]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = (uint)get_local_id(0); i < 3U; i += (uint)get_local_size(0)) {
    atomic_min(&result[i], all_lower[i]);
    atomic_max(&result[3U + i], all_upper[i]);
  }
#endif
}
