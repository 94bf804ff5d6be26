/* Sorts the changes of a frame into canonical order, by b, then by a, or by world first. Writes the counts to `result`,
   unless it is null, followed by the added pairs, then the removed ones, unless these two have buffers of their own.
   Prepares the counts of the next frame.

   A small number of changes is sorted in one launch: each work-group chooses a range of the order, by a sample,
   collects the changes in that range and sorts them. (Frazer and McKellar 1970, "Samplesort: A Sampling Approach to
   Minimal Storage Tree Sorting"; here, work-groups do not share what they learn.) A large number is counted in buckets,
   by their list and the higher bits of their b, or by their world. Prefix sums tell where each bucket begins, and
   within a bucket each change is compared with every other. In either case nothing is written if there is not enough
   memory for all changes; if a bucket is large, the host enqueues a radix sort instead. */

#include "delta.h"
#include "sizes.h"

#ifndef GROUP
#define GROUP 256 /* work-items per work-group of order_small: 1, or a multiple of 4 */
#endif
#ifndef LARGEST_RANGE
#define LARGEST_RANGE 512U /* changes that a work-group sorts at once: a multiple of 4, at least GROUP and 128 */
#endif
#define BATCH 8U /* changes that a work-item loads at once */
#define LARGEST_BUCKET 4096U

/* Position in canonical order: by b, then by a. */
static inline ulong order_of(const uint2 pair) {
  return ((ulong)pair.y << 32) | pair.x;
}

/* The changes of a frame. */
typedef struct {
  uint added_count, removed_count;
  global const uint2* added;
  global const uint2* removed;
} changes_t;

/* (Not returned as a value: Oclgrind 21.10 does not support the resulting code.) */
static inline void find_changes(changes_t* changes, const uint capacity, global const uint2* pairs,
                                global const uint2* removed, global const uint* counts) {
  changes->added_count = counts[COUNT_ADDED];
  changes->removed_count = counts[COUNT_REMOVED];
  changes->added = pairs + (capacity - changes->added_count);
  changes->removed = removed;
}

/* The pairs of a frame, and where to write the changes. `added` and `removed` are null if the changes follow the
   counts. `report`, if not null, receives what a caller who does not wait has to know: the numbers of added, removed
   and all pairs, and whether the frame is incomplete. */
#define CHANGES_PARAMETERS                                                                                       \
  const order_scalars_t scalars, global const uint2 *restrict pairs, global const uint2 *restrict removed_pairs, \
      global uint *restrict counts
#define RESULT_PARAMETERS                                                                           \
  global uint *restrict next_counts, global uint *result, global uint *report, global uint2 *added, \
      global uint2 *removed

/* Whether all pairs were found and all changes fit. */
static inline bool fits(const changes_t* changes, const order_scalars_t* scalars, global const uint* counts) {
  const bool changes_fit =
      changes->added_count <= scalars->list_capacity && changes->removed_count <= scalars->list_capacity &&
      changes->removed_count <= scalars->total_capacity &&
      changes->added_count <= scalars->total_capacity - changes->removed_count;
  return !is_halted(counts) && all_fit(counts, scalars->capacity) && changes_fit;
}

/* Whether the changes are also sorted. */
static inline bool is_complete(const changes_t* changes, const order_scalars_t* scalars, global const uint* counts) {
  return fits(changes, scalars, counts) && counts[COUNT_UNORDERED] == 0U;
}

/* Copies a count, unless nobody waits for it, and prepares it for the next frame. */
static inline void pass_count(const uint k, const changes_t* changes, const bool complete, global const uint* counts,
                              const uint tag, global uint* next_counts, global uint* result, global uint* report) {
  if (result != 0) result[k] = counts[k];
  uint next = 0;
  if (k == COUNT_LAST_KEPT) next = complete ? counts[COUNT_KEPT] : counts[k];
  if (k == COUNT_LAST_ADDED) next = complete ? counts[COUNT_ADDED] : counts[k];
  if (k == COUNT_LAST_TAG) next = complete ? tag : counts[k];
  if (k == COUNT_COMPLETE && report != 0) next = counts[k] + (complete ? 1U : 0U);
  if (k == COUNT_HALTED) next = complete ? 0U : 1U;
  next_counts[k] = next;
  if (report == 0 || k != 0U) return;
  report[0] = complete ? changes->added_count : 0U;
  report[1] = complete ? changes->removed_count : 0U;
  report[2] = complete ? counts[COUNT_KEPT] + counts[COUNT_ADDED] : last_found(counts);
  report[3] = complete ? 0U : 1U;
}

/* Where to write a list of changes. */
static inline global uint2* result_list(const bool is_added, const changes_t* changes, global uint* result,
                                        global uint2* added, global uint2* removed) {
  if (is_added) return added != 0 ? added : (global uint2*)(result + COUNTS);
  return removed != 0 ? removed : (global uint2*)(result + COUNTS) + changes->added_count;
}

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
  range->first_b = (uint)(begin >> 32);
  range->more_bs = (uint)((end - 1UL) >> 32) - range->first_b;
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
                       local sorting_t* shared, global uint2* to) {
  local ulong* collected = (local ulong*)shared->collected;
  const uint item = (uint)get_local_id(0);
  collected[item] = item < size ? order_of(list[item]) : ULONG_MAX;
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint part = (size + groups - 1U) / groups;
  const uint k = group * part + item;
  if (item < part && k < size) to[rank_of(collected[k], shared->collected, (size + 3U) / 4U * 4U)] = list[k];
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
    if (k < padded_samples) collected[k] = k < samples ? order_of(list[k * (size / samples)]) : ULONG_MAX;
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
  const ulong order = order_of(pair);
  if (order < range->begin) {
    ++*below;
  } else if (order < range->end) {
    const uint k = atomic_inc(&shared->count);
    if (k < LARGEST_RANGE) ((local ulong*)shared->collected)[k] = order;
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
INLINE bool place_range(local sorting_t* shared, global uint2* to) {
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
      to[shared->before + k] = (uint2)((uint)shared->sorted[k], (uint)(shared->sorted[k] >> 32));
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
    place_part(group, groups, list, size, &shared, to);
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
    const bool is_whole = place_range(&shared, to);
    begin = is_whole ? end : begin;
    end = is_whole ? last : shared.sorted[LARGEST_RANGE / 4U];
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}

/* Number of changes if all fit, otherwise 0. */
static inline uint number_to_order(const changes_t* changes, const order_scalars_t* scalars,
                                   global const uint* counts) {
  return fits(changes, scalars, counts) ? changes->added_count + changes->removed_count : 0U;
}

static inline uint2 change(const changes_t* changes, const uint k) {
  return k < changes->added_count ? changes->added[k] : changes->removed[k - changes->added_count];
}

/* The world of a pair: that of both objects, or of the one that is not in all worlds; `worlds` if both are in all
   worlds, or if the world is not less than `worlds`. */
static inline uint world_of(const uint2 pair, const uint worlds, global const uint4* filters) {
  if (filters == 0) return 0;
  const uint world = filters[pair.y].w != ALL_WORLDS ? filters[pair.y].w : filters[pair.x].w;
  return min(world, worlds);
}

/* There are `buckets_of_list` buckets for added pairs, then as many for removed ones. A bucket has the pairs of
   2^bucket_bits values of b; unless `worlds` is 0, it is a world, according to the filters of this frame and the last
   one. */
#define BUCKET_PARAMETERS                                                                                \
  global uint *restrict buckets, global uint2 *restrict scattered, global const uint4 *restrict filters, \
      global const uint4 *restrict last_filters
#define BUCKET_OF(k, pair) bucket_of(&changes, k, pair, &scalars, filters, last_filters)

static inline uint bucket_of(const changes_t* changes, const uint k, const uint2 pair, const order_scalars_t* scalars,
                             global const uint4* filters, global const uint4* last_filters) {
  const bool is_added = k < changes->added_count;
  const uint bucket = scalars->worlds == 0U ? pair.y >> scalars->bucket_bits
                                            : world_of(pair, scalars->worlds, is_added ? filters : last_filters);
  return is_added ? bucket : scalars->buckets_of_list + bucket;
}

/* Counts the changes of each bucket, in `buckets`, which must be zeros. */
kernel void order_count(CHANGES_PARAMETERS, BUCKET_PARAMETERS) {
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const uint n = number_to_order(&changes, &scalars, counts);
  (void)scattered;
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const uint before = atomic_inc(&buckets[BUCKET_OF(k, change(&changes, k))]);
    if (before == LARGEST_BUCKET) counts[COUNT_UNORDERED] = 1;
  }
}

/* Moves the changes to their buckets. Each entry of `buckets`, prefix sums of the counts, is the start of its bucket
   before, and the end afterwards. */
kernel void order_scatter(CHANGES_PARAMETERS, BUCKET_PARAMETERS) {
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const uint n = number_to_order(&changes, &scalars, counts);
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const uint2 pair = change(&changes, k);
    scattered[atomic_inc(&buckets[BUCKET_OF(k, pair)])] = pair;
  }
}

/* Sorts the pairs of each bucket, and sets the counts to 0 for the next frame. */
kernel void order_place(CHANGES_PARAMETERS, BUCKET_PARAMETERS, global uint* restrict bucket_counts, RESULT_PARAMETERS) {
  const uint item = (uint)get_global_id(0);
  for (uint k = item; k < 2U * scalars.buckets_of_list; k += (uint)get_global_size(0)) bucket_counts[k] = 0;
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const bool complete = is_complete(&changes, &scalars, counts);
  for (uint i = item; i < COUNTS; i += (uint)get_global_size(0)) {
    pass_count(i, &changes, complete, counts, scalars.tag, next_counts, result, report);
  }
  const uint n = complete ? changes.added_count + changes.removed_count : 0U;
  for (uint k = item; k < n; k += (uint)get_global_size(0)) {
    const uint2 pair = scattered[k];
    const uint bucket = BUCKET_OF(k, pair);
    const uint begin = bucket == 0 ? 0U : buckets[bucket - 1U];
    const uint end = buckets[bucket];
    uint index = begin;
    for (uint other = begin; other < end; ++other) {
      index += order_of(scattered[other]) < order_of(pair) ? 1U : 0U;
    }
    const bool is_added = k < changes.added_count;
    result_list(is_added, &changes, result, added, removed)[index - (is_added ? 0U : changes.added_count)] = pair;
  }
}

/* Finds where each world begins in lists that are sorted by world, one work-item per world; after the worlds come the
   pairs of no such world and the end. The lengths are those of `report`, unless it is null. */
kernel void order_offsets(const uint worlds, const uint added_count, const uint removed_count,
                          global const uint* restrict report, global const uint2* restrict added,
                          global const uint2* restrict removed, global const uint4* restrict filters,
                          global const uint4* restrict last_filters, global uint* restrict added_offsets,
                          global uint* restrict removed_offsets) {
  const uint world = (uint)get_global_id(0);
  if (world > worlds + 1U) return;
  for (uint list = 0; list < 2U; ++list) {
    const bool is_added = list == 0U;
    uint begin = 0;
    uint end = report != 0 ? report[list] : is_added ? added_count : removed_count;
    while (begin < end) {
      const uint middle = begin + (end - begin) / 2U;
      const uint2 pair = is_added ? added[middle] : removed[middle];
      if (world_of(pair, worlds, is_added ? filters : last_filters) < world) {
        begin = middle + 1U;
      } else {
        end = middle;
      }
    }
    (is_added ? added_offsets : removed_offsets)[world] = begin;
  }
}

/* In lists of pairs of two sets, replaces the slots of the second set, which begins at slot `first`, by indices in that
   set. The lengths are those of `report`, unless it is null. */
kernel void order_renumber(const uint first, const uint added_count, const uint removed_count,
                           global const uint* restrict report, global uint2* restrict added,
                           global uint2* restrict removed) {
  const uint added_end = report != 0 ? report[0] : added_count;
  const uint end = added_end + (report != 0 ? report[1] : removed_count);
  for (uint k = (uint)get_global_id(0); k < end; k += (uint)get_global_size(0)) {
    if (k < added_end) {
      added[k].y -= first;
    } else {
      removed[k - added_end].y -= first;
    }
  }
}

/* For a stable sort by world: elements are indices of a list, and the worlds of its pairs. */
kernel void order_world_keys(const uint n, const uint worlds, global const uint2* restrict list,
                             global const uint4* restrict filters, global uint2* restrict elements) {
  const uint k = (uint)get_global_id(0);
  if (k < n) elements[k] = (uint2)(k, world_of(list[k], worlds, filters));
}

/* Moves the pairs of a list to the order of such elements. */
kernel void order_pick(const uint n, global const uint2* restrict elements, global const uint2* restrict list,
                       global uint2* restrict to) {
  const uint k = (uint)get_global_id(0);
  if (k < n) to[k] = list[elements[k].x];
}
