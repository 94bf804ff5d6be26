/* The reduction of boxes to the bounds of their centroids. Boxes without a centroid are ignored. */

#include "centroids.h"
#include "sizes.h"

#if WORLDS
/* Merges into the bounds of a world. */
static inline void merge(const uint extremes[CENTROID_WORDS], const uint bucket, global uint* result) {
  for (uint i = 0; i < CENTROID_WORDS; ++i) atomic_max(&result[CENTROID_WORDS * bucket + i], extremes[i]);
}
#endif

/* The bounds of the centroids: for each bucket of worlds the maxima of -x, -y, -z, x, y, z, as ordered() makes them; 0
   before. Without worlds there is one bucket. */
kernel void centroids(const uint n, global const float* restrict boxes, global const uint4* restrict filters,
                      const uint buckets, global uint* restrict result) {
  uint extremes[CENTROID_WORDS] = {0, 0, 0, 0, 0, 0};
#if WORLDS
  uint bucket = 0;
#endif
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const float3 m = centroid(boxes + (size_t)k * AABB_FLOATS);
    if (isnan(m.x)) continue;
#if WORLDS
    const uint other = bucket_of_world(filters[k].w, buckets);
    if (other != bucket) {
      if (extremes[0] != 0U) merge(extremes, bucket, result);
      for (uint i = 0; i < CENTROID_WORDS; ++i) extremes[i] = 0;
      bucket = other;
    }
#endif
    const float values[CENTROID_WORDS] = {-m.x, -m.y, -m.z, m.x, m.y, m.z};
    for (uint i = 0; i < CENTROID_WORDS; ++i) extremes[i] = max(extremes[i], ordered(values[i]));
  }
#if WORLDS
  if (extremes[0] != 0U) merge(extremes, bucket, result);
#else
  (void)filters;
  (void)buckets;
  local uint all_extremes[CENTROID_WORDS];
  if (get_local_id(0) == 0) {
    for (uint i = 0; i < CENTROID_WORDS; ++i) all_extremes[i] = 0;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = 0; i < CENTROID_WORDS; ++i) atomic_max(&all_extremes[i], extremes[i]);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = (uint)get_local_id(0); i < CENTROID_WORDS; i += (uint)get_local_size(0))
    atomic_max(&result[i], all_extremes[i]);
#endif
}
