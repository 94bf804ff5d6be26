/* Keeps the pairs of the last frame that are still pairs, and collects the others: keep.h. */

#ifndef GROUP
#define GROUP 256 /* work-items per work-group; 1 with the tuning for CPUs */
#endif
#include "sizes.h"
#define KEEP_RUN DELTA_RUN_OF(GROUP)
#include "keep.h"

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void delta_keep(KEEP_KERNEL_PARAMETERS) {
#if GROUP > 1
  local keep_t chunk;
  keep_pairs(&keep_scalars, last, removed, keep_filters, keep_exclusions, keep_stamps, boxes, ungrown, pairs, counts,
             (uint)get_group_id(0), (uint)get_num_groups(0), &chunk);
#else
  const uint last_kept = counts[COUNT_LAST_KEPT];
  const uint first = (uint)get_global_id(0) * KEEP_RUN;
  const uint end = is_halted(counts) ? 0U : min(first + KEEP_RUN, last_found(counts));
  uchar kept[KEEP_RUN];
  uint kept_count = 0;
  uint removed_count = 0;
  for (uint k = first; k < end; ++k) {
    const uint2 pair = list_pair(last, keep_scalars.last_capacity, k, last_kept);
    /* (A branch, because in Oclgrind 21.10 such a condition, used as a number, is not always 1.) */
    if (is_kept(pair, &keep_scalars, boxes, ungrown, keep_filters, keep_exclusions, keep_stamps)) {
      kept[k - first] = 1;
      ++kept_count;
    } else {
      kept[k - first] = 0;
      ++removed_count;
    }
  }
  if (first >= end) return;
  uint next_removed = atomic_add(&counts[COUNT_REMOVED], removed_count);
  uint next_kept = atomic_add(&counts[COUNT_KEPT], kept_count);
  for (uint k = first; k < end; ++k) {
    const uint2 pair = list_pair(last, keep_scalars.last_capacity, k, last_kept);
    if (kept[k - first] == 0) {
      removed[next_removed++] = pair;
    } else {
      if (next_kept < keep_scalars.capacity) pairs[next_kept] = pair;
      ++next_kept;
    }
  }
#endif
}
