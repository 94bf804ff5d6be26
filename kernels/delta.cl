/* What changed between two frames: delta.h says what stands where. Only what changed is put in canonical order. */

#include "delta.h"

#ifndef PARTS
#define PARTS 64 /* work-items of a team, which places pairs together */
#endif
#define TEAMS 2 /* teams of so many work-items a work-group */
#define KEYS 4  /* pairs that a team places at once */

/* Puts the pairs of the last frame of which neither object changed, without a test. */
kernel void delta_carry(const uint last_found, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  local uint places[2]; /* how many, and the first */
  if (get_local_id(0) == 0) places[0] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint k = (uint)get_global_id(0);
  uint2 pair = (uint2)(0);
  bool stays = false;
  uint mine = 0;
  if (k < last_found) {
    pair = last[k];
    stays = !is_changed(stamps[pair.x], stamp) && !is_changed(stamps[pair.y], stamp);
    if (stays) mine = atomic_inc(&places[0]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  if (get_local_id(0) == 0) places[1] = places[0] == 0 ? 0U : reserve_pairs(&sink, places[0]);
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint place = places[1] + mine;
  if (stays && place >= mine && enlist(&sink, place, pair, hash_pair(pair))) kept[k] = 1;
}

/* Puts the pairs of a list into its table, which is all zero. */
kernel void delta_index(const uint found, global const uint2* restrict pairs, global uint* restrict table,
                        const uint mask) {
  const uint k = (uint)get_global_id(0);
  if (k < found) index_pair(table, mask, k, hash_pair(pairs[k]));
}

/* Collects the pairs of the last frame that were not kept, and leaves `kept` and the last frame's table all zero. */
kernel void delta_sweep(const uint capacity, global const uint2* restrict last, const uint last_found,
                        global uint* restrict last_table, const uint last_mask, global uchar* restrict kept,
                        global uint2* restrict removed, global uint* restrict counts) {
  if (!all_fit(counts, capacity)) return;
  const uint size = (uint)get_global_size(0);
  for (uint k = (uint)get_global_id(0); k < last_found; k += size) {
    if (kept[k] == 0) removed[atomic_inc(&counts[COUNT_REMOVED])] = last[k];
    kept[k] = 0;
  }
  /* The mask may be the largest uint there is. */
  for (ulong k = get_global_id(0); k <= last_mask; k += size) last_table[k] = 0;
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
    const uint capacity, global const uint2* restrict added, global const uint2* restrict removed,
    global const uint* restrict counts, global uint* restrict next_counts, global uint* restrict result) {
  local uint places[TEAMS * KEYS];
  const uint part = (uint)get_local_id(0);
  const bool is_added = get_group_id(2) == 0;
  const uint first = (uint)get_global_id(1) * KEYS;
  if (is_added && part == 0 && get_global_id(1) < COUNTS) {
    result[get_global_id(1)] = counts[get_global_id(1)];
    next_counts[get_global_id(1)] = 0;
  }
  if (!all_fit(counts, capacity)) return;

  const uint added_count = counts[COUNT_ADDED];
  const uint removed_count = counts[COUNT_REMOVED];
  const uint size = is_added ? added_count : removed_count;
  global const uint2* list = is_added ? added : removed;
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
