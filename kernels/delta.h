/* The list to which a kernel appends the pairs that it finds, in no particular order.

   The boxes and filters of the last frame are still available: two objects were a pair then if those boxes overlap and
   those filters let them pair. So only new pairs are appended, from the end of the list backwards. The pairs that stay
   from the last frame are written from the beginning: by delta.cl, before other kernels append, or by these kernels
   themselves, which saves a launch.

   All pairs are counted, but only those that fit are appended; if there are more, the host enlarges the list and runs
   the frame again. Nothing of the last frame is overwritten. */
#ifndef BROADCL_DELTA_H
#define BROADCL_DELTA_H

#include "aabb.h"
#include "arguments.h"
#include "counts.h"
#include "distance.h"
#include "filter.h"
#include "inline.h"
#include "stamp.h"

typedef struct {
  uint capacity, last_slots, stamp;    /* arguments.h */
  global uint2* pairs;                 /* the list of this frame */
  global const float8* ungrown;        /* of this frame: distance.h; null if distances need not be tested */
  global const float8* last_ungrown;   /* of the last frame */
  global const float* last_boxes;      /* likewise */
  global const uint4* last_filters;    /* of the last frame; null if they forbade no pair that is allowed now */
  global const uint2* last_exclusions; /* likewise */
  global const uint* stamps;           /* one word per slot: stamp.h; null if no object was replaced */
  global uint* counts;
} pair_sink_t;

#define PAIR_SINK_PARAMETERS                                                                              \
  const sink_scalars_t sink_scalars, global uint2 *restrict pairs, global const float8 *restrict ungrown, \
      global const float8 *restrict last_ungrown, global const float *restrict last_boxes,                \
      global const uint4 *restrict last_filters, global const uint2 *restrict last_exclusions,            \
      global const uint *restrict stamps, global uint *restrict counts
#define PAIR_SINK                                                                                                 \
  {                                                                                                               \
    sink_scalars.capacity, sink_scalars.last_slots, sink_scalars.stamp, pairs, ungrown, last_ungrown, last_boxes, \
        last_filters, last_exclusions, stamps, counts                                                             \
  }

/* A pair of a list, of which `kept` are at the beginning. */
static inline uint2 list_pair(global const uint2* pairs, const uint capacity, const uint k, const uint kept) {
  return pairs[k < kept ? k : capacity - 1U - (k - kept)];
}

/* Pairs of the last frame. */
static inline uint last_found(global const uint* counts) {
  return counts[COUNT_LAST_KEPT] + counts[COUNT_LAST_ADDED];
}

/* The box of a slot's object in the last frame; empty if the object did not exist. */
static inline void load_last_box(box_t* box, const pair_sink_t* sink, const uint slot) {
  const bool was_there =
      slot < sink->last_slots && (sink->stamps == 0 || !is_recycled(sink->stamps[slot], sink->stamp));
  if (was_there) {
    load_box(box, sink->last_boxes, slot);
  } else {
    make_empty(box);
  }
}

/* Whether two objects whose boxes of the last frame overlap were a pair. */
static inline bool could_pair(const pair_sink_t* sink, const uint2 pair) {
  if (is_excluded(pair, sink->last_exclusions)) return false;
  return sink->last_filters == 0 || may_pair(sink->last_filters[pair.x], sink->last_filters[pair.y]);
}

static inline bool was_in_last_frame(const pair_sink_t* sink, const uint2 pair) {
  box_t s;
  box_t t;
  load_last_box(&s, sink, pair.x);
  load_last_box(&t, sink, pair.y);
  return boxes_overlap(&s, &t) && are_within_reach(sink->last_ungrown, pair) && could_pair(sink, pair);
}

/* Reserves indices for `total` pairs; returns the first. (If there are too many pairs for 32 bits, indices repeat; but
   then the frame runs again or fails, and its list is not used.) */
static inline uint reserve_pairs(const pair_sink_t* sink, const uint total) {
  const uint base = atomic_add(&sink->counts[COUNT_ADDED], total);
  if (base + total < base) atomic_inc(&sink->counts[COUNT_ADDED_HIGH]);
  return base;
}

/* Appends the k-th pair of a reservation. */
static inline void append_pair(const pair_sink_t* sink, const uint base, const uint k, const uint2 pair) {
  if (base + k < sink->capacity) sink->pairs[sink->capacity - 1U - (base + k)] = pair;
}

/* Appends `count` pairs in local memory; `base` is local memory for its use. All `size` work-items of a work-group must
   call it, and then pass a barrier: inline.h. */
INLINE void append_pairs(const pair_sink_t* sink, local const uint2* pairs, const uint count, const uint size,
                         local uint* base) {
  const uint item = (uint)get_local_id(0);
  if (count == 0U) return;
  if (item == 0U) *base = reserve_pairs(sink, count);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint k = item; k < count; k += size) append_pair(sink, *base, k, pairs[k]);
}

/* Whether an earlier frame was incomplete. */
static inline bool is_halted(global const uint* counts) {
  return counts[COUNT_HALTED] != 0U;
}

/* Whether every pair found fitted. (If not, the pairs written from the end ran into those from the beginning.) */
static inline bool all_fit(global const uint* counts, const uint capacity) {
  return counts[COUNT_KEPT] <= capacity && counts[COUNT_ADDED] <= capacity - counts[COUNT_KEPT] &&
         counts[COUNT_ADDED_HIGH] == 0U;
}

#endif
