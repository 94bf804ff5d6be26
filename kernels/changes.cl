/* Brings the device's copy of the objects up to date. */

#include "aabb.h"
#include "delta.h"

/* Copies the boxes of some slots, one work-item per slot. */
kernel void copy_boxes(const uint count, global const uint* restrict slots, global const float* restrict from,
                       global float* restrict to) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const size_t first = (size_t)slots[k] * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) to[first + i] = from[first + i];
}

/* Applies changes, one work-item per change. `changes` has one word per change, slot << 1 | recycled, followed by
   the boxes; unless all boxes were uploaded at once: then `boxes` and `changed` are null and only stamps are set. */
kernel void apply_changes(const uint count, global const uint* restrict changes, const uint stamp,
                          global uint* restrict boxes, global uint* restrict stamps, global uint* restrict changed) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = changes[k] >> 1;
  stamps[slot] = stamp << 1 | (changes[k] & 1U);
  if (boxes == 0) return;
  changed[k] = slot;
  global const uint* box = changes + count + (size_t)k * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) boxes[(size_t)slot * AABB_FLOATS + i] = box[i];
}

/* Copies boxes from elsewhere on the device, where each box begins `stride` floats after the one before, and filters,
   unless they are null, one work-item per box. Empty boxes become NaNs, as the host packs them. Those with a NaN bound
   are counted. */
kernel void gather_boxes(const uint n, global const float* restrict source, const ulong offset, const ulong stride,
                         global const uint4* restrict source_filters, global float* restrict boxes,
                         global uint4* restrict filters, global uint* restrict counts) {
  const uint k = (uint)get_global_id(0);
  if (k >= n || is_halted(counts)) return;
  if (filters != 0) filters[k] = source_filters[k];
  global const float* p = source + offset + k * stride;
  global float* q = boxes + (size_t)k * AABB_FLOATS;
  bool proper = true;
  for (uint i = 0; i < 3U; ++i) proper = proper && p[i] <= p[i + 3U];
  if (!proper) {
    bool has_nan = false;
    for (uint i = 0; i < AABB_FLOATS; ++i) has_nan = has_nan || isnan(p[i]) != 0;
    if (has_nan) {
      atomic_inc(&counts[COUNT_INVALID]);
      atomic_max(&counts[COUNT_INVALID_FIRST], UINT_MAX - k);
    }
  }
  for (uint i = 0; i < AABB_FLOATS; ++i) q[i] = proper ? p[i] : NAN;
}
