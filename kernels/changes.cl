/* Updates the device's copy of the objects. */

#include "aabb.h"
#include "distance.h"
#include "gather.h"
#include "stamp.h"

/* Copies the boxes of some slots, and their filters and boxes without reaches unless those are null, one work-item per
   slot. */
kernel void copy_objects(const uint count, global const uint* restrict slots, global const float* restrict from,
                         global float* restrict to, global const uint4* restrict from_filters,
                         global uint4* restrict filters, global const float8* restrict from_ungrown,
                         global float8* restrict ungrown) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = slots[k];
  const size_t first = (size_t)slot * AABB_FLOATS;
  for (uint i = 0; i < AABB_FLOATS; ++i) to[first + i] = from[first + i];
  if (filters != 0) filters[slot] = from_filters[slot];
  if (ungrown != 0) ungrown[slot] = from_ungrown[slot];
}

/* Applies changes, one work-item per change. `changes` has one word per change, a slot as with_recycled() makes
   it, followed by the boxes, the reaches, and the filters. If all boxes were uploaded at once, `boxes`, `ungrown` and
   `changed` are null, and boxes and reaches are left out; so are reaches if `ungrown` is null, and filters if `filters`
   is. */
kernel void apply_changes(const uint count, global const uint* restrict changes, const uint stamp,
                          global float* restrict boxes, global uint* restrict filters, global uint* restrict stamps,
                          global uint* restrict changed, global float8* restrict ungrown) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint slot = changes[k] >> 1;
  stamps[slot] = with_recycled(stamp, changes[k] & 1U);
  global const uint* next = changes + count;
  if (boxes != 0) {
    changed[k] = slot;
    for (uint i = 0; i < AABB_FLOATS; ++i) {
      boxes[(size_t)slot * AABB_FLOATS + i] = as_float(next[(size_t)k * AABB_FLOATS + i]);
    }
    next += (size_t)count * AABB_FLOATS;
  }
  if (ungrown != 0) {
    grow(boxes, ungrown, slot, as_float(next[k]));
    next += count;
  }
  if (filters != 0) vstore4(vload4(k, next), slot, filters);
}

/* Grows n boxes by their reaches, or by those of the last frame if `reaches` is null, one work-item per box. */
kernel void grow_boxes(const uint n, global const float* restrict reaches, global const float8* restrict last_ungrown,
                       global float* restrict boxes, global float8* restrict ungrown) {
  const uint k = (uint)get_global_id(0);
  if (k < n) grow(boxes, ungrown, k, reaches != 0 ? reaches[k] : last_ungrown[k].s6);
}

/* Copies the caller's objects, one work-item per object. */
kernel void gather_boxes(const uint n, GATHER_PARAMETERS) {
  const uint k = (uint)get_global_id(0);
  if (k >= n) return;
  box_t box;
  gather_object(&box, k, source, offset, stride, first_count, second, second_offset, second_stride, source_filters,
                boxes, filters, counts);
}
