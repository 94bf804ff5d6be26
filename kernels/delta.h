/* Where a kernel puts the pairs it finds, in no particular order, and what becomes of them.

   Each pair goes to the list of this frame and into its hash table, and is looked up among those of the last frame: found,
   it is kept, else it was added. Tables hold places in their list plus one, 0 is free, and are probed linearly.

   All pairs are counted, those that fit are put: where the count exceeds the capacity the host makes the list larger and
   runs the frame again. */
#ifndef BROADCL_DELTA_H
#define BROADCL_DELTA_H

#include "stamp.h"

/* What is counted, as uints. The number of pairs found has 64 bits in two: no 64-bit atomics are needed. */
#define COUNT_FOUND 0
#define COUNT_FOUND_HIGH 1
#define COUNT_ADDED 2
#define COUNT_REMOVED 3
#define COUNT_WORK 4 /* what an algorithm counts for itself */
#define COUNTS 6     /* an even number, so that pairs can follow */

typedef struct {
  uint capacity;             /* of the list of this frame */
  global uint2* pairs;       /* the list of this frame */
  global uint* table;        /* its table */
  uint mask;                 /* entries of the table less one */
  global const uint2* last;  /* the list of the last frame */
  global const uint* last_table;
  uint last_mask;
  global uchar* kept;          /* a byte a pair of the last frame, 1 where this frame found it too */
  uint any_renewed;            /* whether some object is another one than in the last frame */
  uint stamp;                  /* of this frame */
  global const uint* stamps;   /* a word a slot: stamp.h */
  global uint2* added;
  global uint* counts;
} pair_sink_t;

#define PAIR_SINK_PARAMETERS                                                                                         \
  const uint capacity, global uint2 *restrict pairs, global uint *restrict table, const uint mask,                   \
      global const uint2 *restrict last, global const uint *restrict last_table, const uint last_mask,               \
      global uchar *restrict kept, const uint any_renewed, const uint stamp, global const uint *restrict stamps,     \
      global uint2 *restrict added, global uint *restrict counts
#define PAIR_SINK                                                                                                    \
  {capacity, pairs, table, mask, last, last_table, last_mask, kept, any_renewed, stamp, stamps, added, counts}

static inline uint hash_pair(const uint2 pair) {
  uint h = pair.x * 0x9e3779b1U ^ pair.y * 0x85ebca77U;
  h ^= h >> 15;
  h *= 0x2c1b3c6dU;
  return h ^ (h >> 13);
}

/* Reserves places for `total` pairs; returns the first. Where there are too many pairs for 32 bits, places would come a
   second time: it is the largest uint then, from which on nothing fits. Work-groups that are in here while the count wraps
   may still get such places, fewer than a table has to spare. */
static inline uint reserve_pairs(const pair_sink_t* sink, const uint total) {
  const uint high = sink->counts[COUNT_FOUND_HIGH];
  const uint base = atomic_add(&sink->counts[COUNT_FOUND], total);
  const bool wraps = base + total < base;
  if (wraps) atomic_inc(&sink->counts[COUNT_FOUND_HIGH]);
  return high != 0U || wraps ? UINT_MAX : base;
}

static inline bool was_in_last_frame(const pair_sink_t* sink, const uint2 pair, const uint hash) {
  if (sink->any_renewed != 0U &&
      (is_renewed(sink->stamps[pair.x], sink->stamp) || is_renewed(sink->stamps[pair.y], sink->stamp))) {
    return false;
  }
  for (uint entry = hash & sink->last_mask; sink->last_table[entry] != 0U; entry = (entry + 1U) & sink->last_mask) {
    const uint place = sink->last_table[entry] - 1U;
    const uint2 last = sink->last[place];
    if (last.x == pair.x && last.y == pair.y) {
      sink->kept[place] = 1;
      return true;
    }
  }
  return false;
}

/* Puts the place of a pair into a table. */
static inline void index_pair(global uint* table, const uint mask, const uint place, const uint hash) {
  uint entry = hash & mask;
  while (atomic_cmpxchg(&table[entry], 0U, place + 1U) != 0U) entry = (entry + 1U) & mask;
}

/* Puts a pair at a place of this frame's list and into its table; false where it does not fit. */
static inline bool enlist(const pair_sink_t* sink, const uint place, const uint2 pair, const uint hash) {
  if (place >= sink->capacity) return false;
  sink->pairs[place] = pair;
  index_pair(sink->table, sink->mask, place, hash);
  return true;
}

/* Puts the k-th pair of a reservation. */
static inline void put_pair(const pair_sink_t* sink, const uint base, const uint k, const uint2 pair) {
  const uint hash = hash_pair(pair);
  const uint place = base + k;
  if (place < base || !enlist(sink, place, pair, hash)) return;
  if (was_in_last_frame(sink, pair, hash)) return;
  const uint added = atomic_inc(&sink->counts[COUNT_ADDED]);
  if (added < sink->capacity) sink->added[added] = pair;
}

/* Whether every pair found was put. */
static inline bool all_fit(global const uint* counts, const uint capacity) {
  return counts[COUNT_FOUND_HIGH] == 0 && counts[COUNT_FOUND] <= capacity;
}

#endif
