/* Which pairs of the last frame are left in this one: delta.h describes the lists. */

#include "delta.h"

#ifndef GROUP
#define GROUP 256 /* work-items per work-group that keeps pairs */
#endif
#ifndef CHUNK
#define CHUNK 1 /* pairs per work-item */
#endif

/* Whether a pair of the last frame is one of this frame. */
static inline bool is_kept(const uint2 pair, const uint slots, global const float* boxes, global const uint4* filters,
                           const uint all, const uint stamp, global const uint* stamps) {
  if (pair.y >= slots) return false;
  if (stamps != 0) {
    const uint s = stamps[pair.x];
    const uint t = stamps[pair.y];
    if (is_recycled(s, stamp) || is_recycled(t, stamp)) return false;
    if (all == 0U && !is_changed(s, stamp) && !is_changed(t, stamp)) return true;
  }
  box_t s;
  box_t t;
  load_box(&s, boxes, pair.x);
  load_box(&t, boxes, pair.y);
  return boxes_overlap(&s, &t) && (filters == 0 || may_pair(filters[pair.x], filters[pair.y]));
}

/* Splits the pairs of the last frame: those that still are pairs are appended before any others, the rest go to
   `removed`. `filters` is null if they separate no pair of the last frame. `all` says whether all slots count as
   changed. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void delta_keep(
    global const uint2* restrict last, const uint slots, global const float* restrict boxes,
    global const uint4* restrict filters, const uint all, const uint stamp, global const uint* restrict stamps,
    const uint capacity, global uint2* restrict pairs, global uint2* restrict removed, global uint* restrict counts) {
  local uint totals[2]; /* pairs removed and kept */
  local uint bases[2];
  const uint lane = (uint)get_local_id(0);
  const uint last_found = is_halted(counts) ? 0U : counts[COUNT_LAST_FOUND];
  const uint first = (uint)get_group_id(0) * (GROUP * CHUNK) + lane;
  if (lane < 1U) totals[0] = totals[1] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);

  uchar kept[CHUNK];
  uint kept_count = 0;
  uint removed_count = 0;
  for (uint k = 0; k < CHUNK; ++k) {
    const uint index = first + k * GROUP;
    if (index >= last_found) break;
    /* (By a branch: what Oclgrind 21.10 makes of this condition as a number is not always 1.) */
    if (is_kept(last[index], slots, boxes, filters, all, stamp, stamps)) {
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
    const uint index = first + k * GROUP;
    if (index >= last_found) break;
    if (kept[k] == 0) {
      removed[next_removed++] = last[index];
    } else {
      if (next_kept < capacity) pairs[next_kept] = last[index];
      ++next_kept;
    }
  }
}
