/* The reduction of boxes to the bounds of their centroids. Those that have none count for nothing. */

#include "centroids.h"

/* The bounds of the centroids: three minima, three maxima, as ordered() makes them. */
kernel void centroids(const uint n, global const float* restrict boxes, global uint* restrict result) {
  uint lower[3] = {0xffffffffU, 0xffffffffU, 0xffffffffU};
  uint upper[3] = {0, 0, 0};
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const float3 m = centroid(boxes + (size_t)k * AABB_FLOATS);
    if (isnan(m.x)) continue;
    const uint words[3] = {ordered(m.x), ordered(m.y), ordered(m.z)};
    for (uint i = 0; i < 3U; ++i) {
      lower[i] = min(lower[i], words[i]);
      upper[i] = max(upper[i], words[i]);
    }
  }
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
  if (get_local_id(0) < 3) {
    atomic_min(&result[get_local_id(0)], all_lower[get_local_id(0)]);
    atomic_max(&result[3 + get_local_id(0)], all_upper[get_local_id(0)]);
  }
}
