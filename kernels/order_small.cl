/* Sorts a small number of changes in one launch: each work-group chooses a range of the order, by a sample, collects
   the changes in that range and sorts them. (Frazer and McKellar 1970, "Samplesort: A Sampling Approach to Minimal
   Storage Tree Sorting"; here, work-groups do not share what they learn.) */

#ifndef GROUP
#define GROUP 256 /* work-items per work-group: 1, or a multiple of 4 */
#endif
#include "order.h"
#include "sizes.h"

#ifndef LARGEST_RANGE
#define LARGEST_RANGE 512U /* changes that a work-group sorts at once: a multiple of 4, at least GROUP and 128 */
#endif
#define BATCH 8U /* changes that a work-item loads at once */

/* Number of values below `value`; `n` is a multiple of 4. */
static inline uint rank_of(const ulong value, local const ulong2* values, const uint n) {
  uint smaller = 0;
  for (uint k = 0; k < n / 2U; k += 2U) {
    const ulong2 s = values[k];
    const ulong2 t = values[k + 1U];
    smaller += (s.x < value ? 1U : 0U) + (s.y < value ? 1U : 0U) + (t.x < value ? 1U : 0U) + (t.y < value ? 1U : 0U);
  }
  return smaller;
}

/* A range of canonical order: from `begin` up to, but not including, `end`. */
typedef struct {
  ulong begin, end;
  uint first_b, more_bs; /* the first b in the range, and how many others follow */
} range_t;

static inline void set_range(range_t* range, const ulong begin, const ulong end) {
  range->begin = begin;
  range->end = end;
  range->first_b = pair_of_key(begin).y;
  range->more_bs = pair_of_key(end - 1UL).y - range->first_b;
}

/* What the work-items of a work-group share while they sort. */
typedef struct {
  ulong2 collected[LARGEST_RANGE / 2U]; /* a sample, then what is in the range */
  ulong sorted[LARGEST_RANGE];
  ulong limits[2];    /* of the range */
  uint before, count; /* changes before the range and in it */
} sorting_t;

/* All work-items must call the functions below that share memory. (All loops with barriers, or before barriers, run
   equally often for all of them: inline.h.) */

/* For a list of at most GROUP changes, which needs no ranges: each work-group places some of them. */
INLINE void place_part(const uint group, const uint groups, global const uint2* list, const uint size,
                       local sorting_t* shared, const order_scalars_t* scalars, global uint2* to) {
  local ulong* collected = (local ulong*)shared->collected;
  const uint item = (uint)get_local_id(0);
  collected[item] = item < size ? key_of_pair(list[item]) : ULONG_MAX;
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint part = (size + groups - 1U) / groups;
  const uint k = group * part + item;
  if (item < part && k < size)
    to[rank_of(collected[k], shared->collected, (size + 3U) / 4U * 4U)] = numbered(list[k], scalars);
}

/* Finds where the range of a work-group begins and ends. All groups take the same sample, of which each needs two
   elements. */
INLINE void find_limits(const uint group, const uint groups, global const uint2* list, const uint size,
                        local sorting_t* shared) {
  local ulong* collected = (local ulong*)shared->collected;
  const uint item = (uint)get_local_id(0);
  const uint of_group = groups > 64U ? 1U : groups > 32U ? 2U : 4U;
  const uint samples = groups == 1U ? 0U : of_group * groups;
  const uint padded_samples = (samples + 3U) / 4U * 4U;
  for (uint first = 0; first < padded_samples; first += GROUP) {
    const uint k = first + item;
    if (k < padded_samples) collected[k] = k < samples ? key_of_pair(list[k * (size / samples)]) : ULONG_MAX;
  }
  if (item == 0U) {
    shared->limits[0] = 0;
    shared->limits[1] = ULONG_MAX;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint first = 0; first < samples; first += GROUP) {
    const uint k = first + item;
    const uint rank = k < samples ? rank_of(collected[k], shared->collected, padded_samples) : samples;
    if (rank == group * of_group && group > 0U) shared->limits[0] = collected[k];
    if (rank == (group + 1U) * of_group && rank < samples) shared->limits[1] = collected[k];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}

/* Counts a pair in `below` if it comes before the range, or among the collected ones if it is in the range. Collects it
   then, unless there are too many. */
static inline void collect_pair(const uint2 pair, const range_t* range, uint* below, local sorting_t* shared) {
  if (pair.y < range->first_b) ++*below;
  if (pair.y - range->first_b > range->more_bs) return;
  const ulong key = key_of_pair(pair);
  if (key < range->begin) {
    ++*below;
  } else if (key < range->end) {
    const uint k = atomic_inc(&shared->count);
    if (k < LARGEST_RANGE) ((local ulong*)shared->collected)[k] = key;
  }
}

/* Collects the changes of a range, and counts those before it. */
INLINE void collect_range(const range_t* range, global const uint2* list, const uint size, local sorting_t* shared) {
  const uint item = (uint)get_local_id(0);
  if (item == 0U) {
    shared->before = 0;
    shared->count = 0;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  uint below = 0;
  uint first = 0;
  for (; first + BATCH * GROUP <= size; first += BATCH * GROUP) {
    uint2 batch[BATCH];
    for (uint i = 0; i < BATCH; ++i) batch[i] = list[first + i * GROUP + item];
    for (uint i = 0; i < BATCH; ++i) collect_pair(batch[i], range, &below, shared);
  }
  uint2 rest[BATCH];
  for (uint i = 0; i < BATCH; ++i) {
    if (first + i * GROUP + item < size) rest[i] = list[first + i * GROUP + item];
  }
  for (uint i = 0; i < BATCH; ++i) {
    if (first + i * GROUP + item < size) collect_pair(rest[i], range, &below, shared);
  }
  atomic_add(&shared->before, below);
  barrier(CLK_LOCAL_MEM_FENCE);
}

/* Sorts the changes that were collected, and places them. Returns whether these are all of the range; otherwise nothing
   is placed, and element LARGEST_RANGE / 4 of `sorted` is where a shorter range may end. */
INLINE bool place_range(local sorting_t* shared, const order_scalars_t* scalars, global uint2* to) {
  local ulong* collected = (local ulong*)shared->collected;
  const uint item = (uint)get_local_id(0);
  const bool is_whole = shared->count <= LARGEST_RANGE;
  const uint n = min(shared->count, LARGEST_RANGE);
  const uint padded = (n + 3U) / 4U * 4U;
  for (uint k = n; k < padded; ++k) {
    if (item == 0U) collected[k] = ULONG_MAX;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint from = 0; from < n; from += GROUP) {
    const uint k = from + item;
    if (k < n) shared->sorted[rank_of(collected[k], shared->collected, padded)] = collected[k];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint from = 0; from < n; from += GROUP) {
    const uint k = from + item;
    if (k < n && is_whole) {
      to[shared->before + k] = numbered(pair_of_key(shared->sorted[k]), scalars);
    }
  }
  return is_whole;
}

/* Sorts a small number of changes. The index of the work-group in dimension 0 is that of its range; in dimension 1 it
   is the list. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void order_small(CHANGES_PARAMETERS, RESULT_PARAMETERS) {
  local sorting_t shared;
  const uint item = (uint)get_local_id(0);
  const uint group = (uint)get_group_id(0);
  const bool is_added = get_group_id(1) == 0;
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const bool complete = is_complete(&changes, &scalars, counts);
  for (uint first = 0; first < COUNTS; first += GROUP) {
    const uint k = first + item;
    if (is_added && group == 0U && k < COUNTS) {
      pass_count(k, &changes, complete, counts, scalars.tag, next_counts, result, report);
    }
  }
  if (!complete) return;
  const uint size = is_added ? changes.added_count : changes.removed_count;
  const uint groups = min(min((uint)get_num_groups(0), LARGEST_RANGE), (size + ORDER_RANGE - 1U) / ORDER_RANGE);
  if (group >= groups) return;
  global const uint2* list = is_added ? changes.added : changes.removed;
  global uint2* to = result_list(is_added, &changes, result, added, removed);
  if (GROUP > 1 && size <= GROUP) {
    place_part(group, groups, list, size, &shared, &scalars, to);
    return;
  }
  find_limits(group, groups, list, size, &shared);
  /* Mostly once; if more than LARGEST_RANGE changes are in the range, it is sorted in parts. */
  const ulong last = shared.limits[1];
  ulong begin = shared.limits[0];
  ulong end = last;
  while (begin < end) {
    range_t range;
    set_range(&range, begin, end);
    collect_range(&range, list, size, &shared);
    const bool is_whole = place_range(&shared, &scalars, to);
    begin = is_whole ? end : begin;
    end = is_whole ? last : shared.sorted[LARGEST_RANGE / 4U];
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
