/* Brute force: tests every pair of boxes and appends those that overlap to a list, in no particular order.

   A work-item holds WIDTH boxes a in registers and walks down rows b, reading one box a row, the same for the whole
   work-group. Hits gather in local memory; a work-group reserves its part of the list with one atomic. Where local
   memory was too small it tests again and writes to its part directly. */

#include "aabb.h"
#include "delta.h"
#include "lanes.h"

#ifndef GROUP
#define GROUP 64 /* work-items a work-group */
#endif
#define LOCAL_HITS 512U

#ifndef ROWS
#define ROWS 4 /* rows that a work-item tests before it looks for hits */
#endif

typedef struct {
  FLOATS lower_x, lower_y, lower_z, upper_x, upper_y, upper_z;
} boxes_t;

INTS test_row(const boxes_t* s, const uint b, global const float* restrict boxes) {
  global const float2* q = (global const float2*)(boxes + (size_t)b * AABB_FLOATS);
  const float2 q0 = q[0];
  const float2 q1 = q[1];
  const float2 q2 = q[2];
  return AABB_OVERLAPS(s->lower_x, s->lower_y, s->lower_z, s->upper_x, s->upper_y, s->upper_z, q0.x, q0.y, q1.x, q1.y,
                       q2.x, q2.y);
}

/* A bit a lane: which of the boxes a, a + 1, ... come before b and overlap it. */
uint hits_before(const INTS hits, const uint a, const uint b) {
  return lane_mask(hits) & (b - a < WIDTH ? (1U << (b - a)) - 1U : ~0U);
}

/* Work-items of dimension 0 stand for WIDTH boxes a each, those of dimension 1 for `rows` rows b each. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void brute_force(
    const uint n, const uint rows, global const float* restrict boxes, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  local uint2 hits[LOCAL_HITS];
  local uint found;
  local uint base;
  if (get_local_id(0) == 0) found = 0;
  barrier(CLK_LOCAL_MEM_FENCE);

  const uint a = (uint)get_global_id(0) * WIDTH;
  const uint begin = max((uint)get_global_id(1) * rows, a + 1U);
  const uint end = min(n, ((uint)get_global_id(1) + 1U) * rows);
  boxes_t s;
  if (begin < end) {
    global const float* p = boxes + (size_t)a * AABB_FLOATS;
    s.lower_x = BOUNDS(p);
    s.lower_y = BOUNDS(p + 1);
    s.lower_z = BOUNDS(p + 2);
    s.upper_x = BOUNDS(p + 3);
    s.upper_y = BOUNDS(p + 4);
    s.upper_z = BOUNDS(p + 5);
  }
  for (uint first = begin; first < end; first += ROWS) {
    INTS rows_hits[ROWS];
    INTS some = 0;
    for (uint r = 0; r < ROWS; ++r) {
      rows_hits[r] = test_row(&s, min(first + r, end - 1U), boxes);
      some |= rows_hits[r];
    }
    if (!any(some)) continue;
    for (uint r = 0; r < min((uint)ROWS, end - first); ++r) {
      uint bits = hits_before(rows_hits[r], a, first + r);
      for (uint lane = 0; bits != 0; ++lane, bits >>= 1) {
        if ((bits & 1U) == 0) continue;
        const uint k = atomic_inc(&found);
        if (k < LOCAL_HITS) hits[k] = (uint2)(a + lane, first + r);
      }
    }
  }

  barrier(CLK_LOCAL_MEM_FENCE);
  const uint total = found;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (get_local_id(0) == 0) {
    base = total == 0 ? 0U : reserve_pairs(&sink, total);
    found = 0;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  if (total <= LOCAL_HITS) {
    for (uint k = (uint)get_local_id(0); k < total; k += GROUP) put_pair(&sink, base, k, hits[k]);
    return;
  }
  for (uint b = begin; b < end; ++b) {
    uint bits = hits_before(test_row(&s, b, boxes), a, b);
    for (uint lane = 0; bits != 0; ++lane, bits >>= 1) {
      if ((bits & 1U) != 0) put_pair(&sink, base, atomic_inc(&found), (uint2)(a + lane, b));
    }
  }
}
