/* Updates the device's copy of the objects. */

#include "aabb.h"
#include "gather.h"
#include "stamp.h"

/* Copies the boxes of some slots, one work-item per slot. */
kernel void copy_boxes(const uint count, global const uint* restrict slots, global const float* restrict from,
                       global float* restrict to) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const size_t first = (size_t)slots[k] * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) to[first + i] = from[first + i];
}

/* Applies changes, one work-item per change. `changes` has one word per change, a slot as with_recycled() makes
   it, followed by the boxes. If all boxes were uploaded at once, `boxes` and `changed` are null and only stamps are
   set. */
kernel void apply_changes(const uint count, global const uint* restrict changes, const uint stamp,
                          global uint* restrict boxes, global uint* restrict stamps, global uint* restrict changed) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = changes[k] >> 1;
  stamps[slot] = with_recycled(stamp, changes[k] & 1U);
  if (boxes == 0) return;
  changed[k] = slot;
  global const uint* box = changes + count + (size_t)k * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) boxes[(size_t)slot * AABB_FLOATS + i] = box[i];
}

/* Stores filters, one work-item per slot. `changes` has the filters, followed by their slots. */
kernel void apply_filters(const uint count, global const uint4* restrict changes, global uint4* restrict filters) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  global const uint* slots = (global const uint*)(changes + count);
  filters[slots[k]] = changes[k];
}

/* Copies the caller's objects, one work-item per object. */
kernel void gather_boxes(const uint n, GATHER_PARAMETERS) {
  const uint k = (uint)get_global_id(0);
  if (k >= n) return;
  box_t box;
  gather_object(&box, k, source, offset, stride, first_count, second, second_offset, second_stride, source_filters,
                boxes, filters, counts);
}
