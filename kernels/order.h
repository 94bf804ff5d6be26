/* The changes of a frame, which order_small.cl or order_buckets.cl sort into canonical order, or by world first. They
   write the counts to `result`, unless it is null, followed by the added pairs, then the removed ones, unless these two
   have buffers of their own, and prepare the counts of the next frame. Nothing is written if there is not enough memory
   for all changes. */
#ifndef BROADCL_ORDER_H
#define BROADCL_ORDER_H

#include "delta.h"

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
   counts. Nobody waits for the frame if `result` is null. `report`, if not null, receives the numbers of added, removed
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
  if (k == COUNT_COMPLETE && result == 0) next = counts[k] + (complete ? 1U : 0U);
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

/* A pair as it is written: of two sets, with the index in the second one. */
static inline uint2 numbered(const uint2 pair, const order_scalars_t* scalars) {
  return (uint2)(pair.x, pair.y - scalars->second_set);
}

/* The world of a pair: that of both objects, or of the one that is not in all worlds; `worlds` if both are in all
   worlds, or if the world is not less than `worlds`. */
static inline uint world_of(const uint2 pair, const uint worlds, global const uint4* filters) {
  if (filters == 0) return 0;
  const uint world = filters[pair.y].w != ALL_WORLDS ? filters[pair.y].w : filters[pair.x].w;
  return min(world, worlds);
}

#endif
