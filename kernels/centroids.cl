/* The reduction of boxes to the bounds of their centroids. Boxes without a centroid are ignored. */

#include "centroids.h"
#include "sizes.h"

/* Moves extremes to the bounds of a world. */
static inline void merge(uint extremes[CENTROID_WORDS], const uint bucket, global uint* result) {
  if (extremes[0] == 0U) return;
  for (uint i = 0; i < CENTROID_WORDS; ++i) {
    atomic_max(&result[CENTROID_WORDS * bucket + i], extremes[i]);
    extremes[i] = 0;
  }
}

/* The bounds of the centroids: for each bucket of worlds the maxima of -x, -y, -z, x, y, z, as ordered() makes them; 0
   before. Without worlds, `filters` is null, and there is one bucket. */
kernel void centroids(const uint n, global const float* restrict boxes, global const uint4* restrict filters,
                      const uint buckets, global uint* restrict result) {
  uint extremes[CENTROID_WORDS] = {0, 0, 0, 0, 0, 0};
  uint bucket = 0;
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const float3 m = centroid(boxes + (size_t)k * AABB_FLOATS);
    if (isnan(m.x)) continue;
    const uint other = filters == 0 ? 0U : bucket_of_world(filters[k].w, buckets);
    if (other != bucket) merge(extremes, bucket, result);
    bucket = other;
    const float values[CENTROID_WORDS] = {-m.x, -m.y, -m.z, m.x, m.y, m.z};
    for (uint i = 0; i < CENTROID_WORDS; ++i) extremes[i] = max(extremes[i], ordered(values[i]));
  }
  if (filters != 0) merge(extremes, bucket, result);
  local uint all_extremes[CENTROID_WORDS];
  if (get_local_id(0) == 0) {
    for (uint i = 0; i < CENTROID_WORDS; ++i) all_extremes[i] = 0;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = 0; i < CENTROID_WORDS; ++i) atomic_max(&all_extremes[i], extremes[i]);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = (uint)get_local_id(0); i < CENTROID_WORDS; i += (uint)get_local_size(0))
    atomic_max(&result[i], all_extremes[i]);
}
