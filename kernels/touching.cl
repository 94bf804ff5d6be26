/* Collects those pairs of a list whose boxes touch, that is, have a bound in common on one of some axes. */

#include "aabb.h"
#include "delta.h"

#define PAIRS_PER_ITEM 8U

/* (Packed boxes of a BroadPhase64 have no -0.) */
static inline bool boxes_touch(const box_t* s, const box_t* t, const uint axes) {
  bool touch = false;
  for (uint axis = 0; axis < 3U; ++axis) {
    if ((axes >> axis & 1U) == 0U) continue;
    if (as_uint(s->bound[axis]) == as_uint(t->bound[axis + 3U])) touch = true;
    if (as_uint(t->bound[axis]) == as_uint(s->bound[axis + 3U])) touch = true;
  }
  return touch;
}

/* `pairs` has `kept` pairs at its beginning and `added` ones at its end. `result` has first a number of pairs, to
   which this one adds those that touch, and which was `counted` before; then these, of which there is memory for
   `most`. `axes` has a bit for each axis that counts. */
kernel void touching_pairs(const uint capacity, const uint kept, const uint added, const uint axes, const uint counted,
                           const uint most, global const uint2* restrict pairs, global const float* restrict boxes,
                           global uint2* restrict result) {
  const uint stride = (uint)get_local_size(0);
  const uint first = (uint)get_group_id(0) * stride * PAIRS_PER_ITEM + (uint)get_local_id(0);
  uint found = 0; /* a bit per pair */
  for (uint i = 0; i < PAIRS_PER_ITEM; ++i) {
    const uint k = first + i * stride;
    if (k >= kept + added) continue;
    const uint2 pair = list_pair(pairs, capacity, k, kept);
    box_t s;
    box_t t;
    load_box(&s, boxes, pair.x);
    load_box(&t, boxes, pair.y);
    if (boxes_touch(&s, &t, axes)) found |= 1U << i;
  }
  if (found == 0U) return;
  uint next = atomic_add((global uint*)result, (uint)popcount(found)) - counted;
  for (uint i = 0; i < PAIRS_PER_ITEM; ++i) {
    if ((found >> i & 1U) == 0U) continue;
    if (next < most) result[1U + next] = list_pair(pairs, capacity, first + i * stride, kept);
    ++next;
  }
}
