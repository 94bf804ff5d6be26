/* Finds the caller's boxes that are not within one box, in the order of their numbers: marks them; then come prefix
   sums of the marks; then copies them. */

#include "aabb.h"

/* The caller's boxes: the first begins at `offset`, and each further one `stride` floats later. */
#define SOURCE_PARAMETERS const uint count, const ulong offset, const ulong stride, global const float *restrict boxes

/* There is one mark more than boxes, so that the sums end with their number. Improper boxes are not marked. */
kernel void mark_outside(SOURCE_PARAMETERS, const float4 lower, const float4 upper, global uint* restrict marks) {
  const uint k = (uint)get_global_id(0);
  if (k > count) return;
  bool is_outside = false;
  if (k < count) {
    global const float* p = boxes + offset + k * stride;
    box_t box;
    for (uint i = 0; i < AABB_FLOATS; ++i) box.bound[i] = p[i];
    const bool is_within =
        (NOT_ABOVE(lower.x, box.bound[0]) & NOT_ABOVE(lower.y, box.bound[1]) & NOT_ABOVE(lower.z, box.bound[2]) &
         NOT_ABOVE(box.bound[3], upper.x) & NOT_ABOVE(box.bound[4], upper.y) & NOT_ABOVE(box.bound[5], upper.z)) != 0;
    is_outside = is_proper(&box) && !is_within;
  }
  marks[k] = is_outside ? 1U : 0U;
}

/* `found` gets the number of boxes, and then a record of each, of which there is memory for `most`: its number, its
   bounds, and its filter unless `filters` is null. */
kernel void copy_outside(SOURCE_PARAMETERS, global const uint* restrict sums, global const uint4* restrict filters,
                         const uint most, global uint* restrict found) {
  const uint k = (uint)get_global_id(0);
  if (k == 0U) found[0] = sums[count];
  if (k >= count) return;
  const uint place = sums[k];
  if (sums[k + 1U] == place || place >= most) return;
  const uint words = 1U + AABB_FLOATS + (filters != 0 ? 4U : 0U);
  global uint* record = found + 1U + (size_t)place * words;
  global const float* p = boxes + offset + k * stride;
  record[0] = k;
  for (uint i = 0; i < AABB_FLOATS; ++i) record[1U + i] = as_uint(p[i]);
  if (filters == 0) return;
  const uint4 filter = filters[k];
  record[7] = filter.x;
  record[8] = filter.y;
  record[9] = filter.z;
  record[10] = filter.w;
}
