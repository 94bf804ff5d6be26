/* What changed between two frames: delta.h says what stands where. Only what changed is put in canonical order. */

#include "delta.h"

#ifndef GROUP
#define GROUP 64 /* work-items a work-group that keeps pairs */
#endif
#ifndef CHUNK
#define CHUNK 4 /* pairs that each of them looks at */
#endif
#ifndef PARTS
#define PARTS 64 /* work-items of a team, which places pairs together */
#endif
#define TEAMS 2 /* teams of so many work-items a work-group */
#define KEYS 4  /* pairs that a team places at once */

/* Whether a pair of the last frame is one of this frame. */
static inline bool is_kept(const uint2 pair, const uint slots, global const float* boxes, const uint any_filters,
                           global const uint4* filters, const uint any_renewed, const uint stamp,
                           global const uint* stamps) {
  if (pair.y >= slots) return false;
  if (any_renewed != 0U && (is_renewed(stamps[pair.x], stamp) || is_renewed(stamps[pair.y], stamp))) return false;
  const box_t s = load_box(boxes, pair.x);
  const box_t t = load_box(boxes, pair.y);
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
    kept[k] = is_kept(last[place], slots, boxes, any_filters, filters, any_renewed, stamp, stamps) ? 1 : 0;
    kept_count += kept[k];
    removed_count += 1U - kept[k];
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

/* Position in canonical order: by b, then by a. */
static inline ulong order_of(const uint2 pair) {
  return ((ulong)pair.y << 32) | pair.x;
}

/* Writes the changes to `result` behind the counts: added, then removed, each pair at the place that the number of
   smaller ones in its list gives it. Work-items of dimension 2 stand for the two lists, those of dimension 1 for KEYS
   pairs each. Where a list has more pairs than they stand for, none is written. Leaves the counts of the next frame
   all zero. */
kernel __attribute__((reqd_work_group_size(PARTS, TEAMS, 1))) void delta_order(
    const uint capacity, const uint last_found, global const uint2* restrict pairs,
    global const uint2* restrict removed, global const uint* restrict counts, global uint* restrict next_counts,
    global uint* restrict result) {
  local uint places[TEAMS * KEYS];
  const uint part = (uint)get_local_id(0);
  const bool is_added = get_group_id(2) == 0;
  const uint first = (uint)get_global_id(1) * KEYS;
  if (is_added && part == 0 && get_global_id(1) < COUNTS) {
    result[get_global_id(1)] = counts[get_global_id(1)];
    next_counts[get_global_id(1)] = 0;
  }
  if (!all_fit(counts, capacity)) return;

  const uint removed_count = counts[COUNT_REMOVED];
  const uint kept = last_found - removed_count;
  const uint added_count = counts[COUNT_FOUND] - kept;
  const uint size = is_added ? added_count : removed_count;
  global const uint2* list = is_added ? pairs + kept : removed;
  global uint2* changes = (global uint2*)(result + COUNTS) + (is_added ? 0U : added_count);
  if (max(added_count, removed_count) > (uint)get_global_size(1) * KEYS) return;
  if ((uint)get_group_id(1) * (TEAMS * KEYS) >= size) return;

  ulong orders[KEYS];
  uint smaller[KEYS];
  for (uint i = 0; i < KEYS; ++i) {
    orders[i] = order_of(list[min(first + i, size - 1U)]);
    smaller[i] = 0;
  }
#pragma unroll 4
  for (uint k = part; k < size; k += PARTS) {
    const ulong other = order_of(list[k]);
    for (uint i = 0; i < KEYS; ++i) smaller[i] += other < orders[i] ? 1U : 0U;
  }
  const uint team = (uint)get_local_id(1) * KEYS;
  for (uint i = part; i < KEYS; i += PARTS) places[team + i] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = 0; i < KEYS; ++i) atomic_add(&places[team + i], smaller[i]);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = part; i < KEYS; i += PARTS) {
    if (first + i < size) changes[places[team + i]] = list[first + i];
  }
}
