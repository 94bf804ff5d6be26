/* Which pairs of the last frame stay in this one: delta.h describes the lists. */
#ifndef BROADCL_KEEP_H
#define BROADCL_KEEP_H

#include "delta.h"
#include "inline.h"

/* The list of the last frame, and where to put the pairs that are removed from it. Filters and exclusions are null if
   they forbid no pair of the list. `keep_all` says whether all slots count as changed; if not, stamps tell which did.
   */
#define KEEP_PARAMETERS KEEP_PARAMETERS_OF(restrict)
/* (No `restrict` in functions: Oclgrind 21.10 does not know what remains of it after inlining.) */
#define KEEP_PARAMETERS_OF(restrict_)                                                                                 \
  global const uint2 *restrict_ last, const uint last_capacity, global uint2 *restrict_ removed,                      \
      global const uint4 *restrict_ keep_filters, global const uint2 *restrict_ keep_exclusions, const uint keep_all, \
      global const uint *restrict_ keep_stamps

/* A pair of the last frame's list, of which `kept` are at the beginning. */
static inline uint2 last_pair(global const uint2* last, const uint last_capacity, const uint k, const uint kept) {
  return last[k < kept ? k : last_capacity - 1U - (k - kept)];
}

/* Whether a pair of the last frame is one of this frame. */
static inline bool is_kept(const uint2 pair, const uint slots, global const float* boxes, global const uint4* filters,
                           global const uint2* exclusions, const uint all, const uint stamp,
                           global const uint* stamps) {
  if (pair.y >= slots) return false;
  if (stamps != 0) {
    const uint s = stamps[pair.x];
    const uint t = stamps[pair.y];
    if (is_recycled(s, stamp) || is_recycled(t, stamp)) return false;
    if (all == 0U && !is_changed(s, stamp) && !is_changed(t, stamp)) return true;
  }
  if (is_excluded(pair, exclusions)) return false;
  box_t s;
  box_t t;
  load_box(&s, boxes, pair.x);
  load_box(&t, boxes, pair.y);
  return boxes_overlap(&s, &t) && (filters == 0 || may_pair(filters[pair.x], filters[pair.y]));
}

/* Keeps the pairs of the last frame that are still pairs, and collects the others. All `size` work-items of a
   work-group must call it; the work is shared by `groups` work-groups, of which this is number `group`. */
INLINE void keep_pairs(KEEP_PARAMETERS_OF(), const uint slots, global const float* boxes, const uint stamp,
                       const uint capacity, global uint2* pairs, global uint* counts, const uint group,
                       const uint groups, const uint size, local uint* totals) {
  const uint item = (uint)get_local_id(0);
  const uint end = is_halted(counts) ? 0U : last_found(counts);
  const uint last_kept = counts[COUNT_LAST_KEPT];
  local uint* bases = totals + 2; /* of removed and kept, as totals */
  for (uint first = group * size; first < end; first += groups * size) {
    const bool exists = first + item < end;
    uint2 pair = 0;
    uint kept = 0;
    if (item < 1U) totals[0] = totals[1] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint k = 0;
    if (exists) {
      pair = last_pair(last, last_capacity, first + item, last_kept);
      if (is_kept(pair, slots, boxes, keep_filters, keep_exclusions, keep_all, stamp, keep_stamps)) kept = 1;
      k = atomic_inc(&totals[kept]);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item < 1U) {
      bases[0] = totals[0] == 0U ? 0U : atomic_add(&counts[COUNT_REMOVED], totals[0]);
      bases[1] = totals[1] == 0U ? 0U : atomic_add(&counts[COUNT_KEPT], totals[1]);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    k += bases[kept];
    if (exists && kept == 0U) removed[k] = pair;
    if (exists && kept != 0U && k < capacity) pairs[k] = pair;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}

#endif
