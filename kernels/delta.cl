/* What of the last frame is left in this one: delta.h says what stands where. */

#include "delta.h"

#ifndef GROUP
#define GROUP 256 /* work-items a work-group that keeps pairs */
#endif
#ifndef CHUNK
#define CHUNK 1 /* pairs that each of them looks at */
#endif

/* Whether a pair of the last frame is one of this frame. */
static inline bool is_kept(const uint2 pair, const uint slots, global const float* boxes, const uint any_filters,
                           global const uint4* filters, const uint any_renewed, const uint stamp,
                           global const uint* stamps) {
  if (pair.y >= slots) return false;
  if (any_renewed != 0U && (is_renewed(stamps[pair.x], stamp) || is_renewed(stamps[pair.y], stamp))) return false;
  box_t s;
  box_t t;
  load_box(&s, boxes, pair.x);
  load_box(&t, boxes, pair.y);
  return boxes_overlap(&s, &t) && (any_filters == 0U || may_pair(filters[pair.x], filters[pair.y]));
}

/* Parts the pairs of the last frame: those that still are pairs are put, the others collected. Before anything else is
   put. `any_filters` tells whether filters may keep apart what was a pair. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void delta_keep(
    const uint last_found, global const uint2* restrict last, const uint slots, global const float* restrict boxes,
    const uint any_filters, global const uint4* restrict filters, const uint any_renewed, const uint stamp,
    global const uint* restrict stamps, const uint capacity, global uint2* restrict pairs,
    global uint2* restrict removed, global uint* restrict counts) {
  local uint totals[2]; /* pairs removed and kept */
  local uint bases[2];
  const uint lane = (uint)get_local_id(0);
  const uint first = (uint)get_group_id(0) * (GROUP * CHUNK) + lane;
  if (lane < 1U) totals[0] = totals[1] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);

  uchar kept[CHUNK];
  uint kept_count = 0;
  uint removed_count = 0;
  for (uint k = 0; k < CHUNK; ++k) {
    const uint place = first + k * GROUP;
    if (place >= last_found) break;
    /* (By a branch: what Oclgrind 21.10 makes of this condition as a number is not always 1.) */
    if (is_kept(last[place], slots, boxes, any_filters, filters, any_renewed, stamp, stamps)) {
      kept[k] = 1;
      ++kept_count;
    } else {
      kept[k] = 0;
      ++removed_count;
    }
  }
  uint next_removed = atomic_add(&totals[0], removed_count);
  uint next_kept = atomic_add(&totals[1], kept_count);
  barrier(CLK_LOCAL_MEM_FENCE);
  if (lane == 0) {
    bases[0] = atomic_add(&counts[COUNT_REMOVED], totals[0]);
    bases[1] = atomic_add(&counts[COUNT_FOUND], totals[1]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  next_removed += bases[0];
  next_kept += bases[1];
  for (uint k = 0; k < CHUNK; ++k) {
    const uint place = first + k * GROUP;
    if (place >= last_found) break;
    if (kept[k] == 0) {
      removed[next_removed++] = last[place];
    } else {
      if (next_kept < capacity) pairs[next_kept] = last[place];
      ++next_kept;
    }
  }
}
