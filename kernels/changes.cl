/* Updates the device's copy of the objects. */

#include "aabb.h"
#include "gather.h"
#include "stamp.h"

/* Copies the boxes of some slots, and their filters unless those are null, one work-item per slot. */
kernel void copy_objects(const uint count, global const uint* restrict slots, global const float* restrict from,
                         global float* restrict to, global const uint4* restrict from_filters,
                         global uint4* restrict filters) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = slots[k];
  const size_t first = (size_t)slot * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) to[first + i] = from[first + i];
  if (filters != 0) filters[slot] = from_filters[slot];
}

/* Applies changes, one work-item per change. `changes` has one word per change, a slot as with_recycled() makes
   it, followed by the boxes, and then the filters. If all boxes were uploaded at once, `boxes` and `changed` are
   null and boxes are left out; so are filters if `filters` is null. */
kernel void apply_changes(const uint count, global const uint* restrict changes, const uint stamp,
                          global uint* restrict boxes, global uint* restrict filters, global uint* restrict stamps,
                          global uint* restrict changed) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = changes[k] >> 1;
  stamps[slot] = with_recycled(stamp, changes[k] & 1U);
  global const uint* next = changes + count;
  if (boxes != 0) {
    changed[k] = slot;
    for (uint i = 0; i < AABB_FLOATS; ++i) boxes[(size_t)slot * AABB_FLOATS + i] = next[(size_t)k * AABB_FLOATS + i];
    next += (size_t)count * AABB_FLOATS;
  }
  if (filters != 0) vstore4(vload4(k, next), slot, filters);
}

/* Copies the caller's objects, one work-item per object. */
kernel void gather_boxes(const uint n, GATHER_PARAMETERS) {
  const uint k = (uint)get_global_id(0);
  if (k >= n) return;
  box_t box;
  gather_object(&box, k, source, offset, stride, first_count, second, second_offset, second_stride, source_filters,
                boxes, filters, counts);
}
