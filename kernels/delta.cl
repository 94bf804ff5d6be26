/* Keeps the pairs of the last frame that still are pairs, and collects the others: keep.h. */

#include "keep.h"

#ifndef GROUP
#define GROUP 256 /* work-items per work-group */
#endif
#ifndef CHUNK
#define CHUNK 1 /* pairs per work-item */
#endif

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void delta_keep(
    KEEP_PARAMETERS, const uint slots, global const float* restrict boxes, const uint stamp,
    global uint2* restrict pairs, global uint* restrict counts) {
  local uint totals[2]; /* pairs removed and kept */
  local uint bases[2];
  const uint lane = (uint)get_local_id(0);
  const uint end = is_halted(counts) ? 0U : last_found(counts);
  const uint last_kept = counts[COUNT_LAST_KEPT];
  const uint first = (uint)get_group_id(0) * (GROUP * CHUNK) + lane;
  if (lane < 1U) totals[0] = totals[1] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);

  uchar kept[CHUNK];
  uint kept_count = 0;
  uint removed_count = 0;
  for (uint k = 0; k < CHUNK; ++k) {
    const uint index = first + k * GROUP;
    if (index >= end) break;
    /* (By a branch: what Oclgrind 21.10 makes of this condition as a number is not always 1.) */
    if (is_kept(last_pair(last, last_capacity, index, last_kept), slots, boxes, keep_filters, keep_all, stamp, keep_stamps)) {
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
    bases[1] = atomic_add(&counts[COUNT_KEPT], totals[1]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  next_removed += bases[0];
  next_kept += bases[1];
  for (uint k = 0; k < CHUNK; ++k) {
    const uint index = first + k * GROUP;
    if (index >= end) break;
    const uint2 pair = last_pair(last, last_capacity, index, last_kept);
    if (kept[k] == 0) {
      removed[next_removed++] = pair;
    } else {
      pairs[next_kept++] = pair;
    }
  }
}
