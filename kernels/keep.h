/* Which pairs of the last frame stay in this one: delta.h describes the lists. GROUP must be defined before this. */
#ifndef BROADCL_KEEP_H
#define BROADCL_KEEP_H

#ifndef KEEP_GROUP
#define KEEP_GROUP GROUP /* work-items per work-group that keeps pairs */
#endif

#include "bits.h"
#include "delta.h"
#include "inline.h"

/* The list of the last frame, and where to append the pairs that are removed from it. Filters and exclusions are null
   if they forbid no pair of the list. */
#define KEEP_PARAMETERS                                                                                 \
  const keep_scalars_t keep_scalars, global const uint2 *restrict last, global uint2 *restrict removed, \
      global const uint4 *restrict keep_filters, global const uint2 *restrict keep_exclusions,          \
      global const uint *restrict keep_stamps

/* Whether a pair of the last frame is one of this frame. */
static inline bool is_kept(const uint2 pair, const keep_scalars_t* keep, global const float* boxes,
                           global const float8* ungrown, global const uint4* filters, global const uint2* exclusions,
                           global const uint* stamps) {
  if (pair.y >= keep->slots) return false;
  if (stamps != 0) {
    const uint s = stamps[pair.x];
    const uint t = stamps[pair.y];
    if (is_recycled(s, keep->stamp) || is_recycled(t, keep->stamp)) return false;
    if (keep->all == 0U && !is_changed(s, keep->stamp) && !is_changed(t, keep->stamp)) return true;
  }
  if (is_excluded(pair, exclusions)) return false;
  box_t s;
  box_t t;
  load_box(&s, boxes, pair.x);
  load_box(&t, boxes, pair.y);
  return boxes_overlap(&s, &t) && are_within_reach(ungrown, pair) &&
         (filters == 0 || may_pair(filters[pair.x], filters[pair.y]));
}

/* What a kernel needs that only keeps pairs: the boxes of this frame (distance.h), and its list. */
#define KEEP_KERNEL_PARAMETERS                                                                \
  KEEP_PARAMETERS, global const float *restrict boxes, global const float8 *restrict ungrown, \
      global uint2 *restrict pairs, global uint *restrict counts

#if GROUP > 1
#ifndef KEEP_RUN
#define KEEP_RUN 1 /* pairs per work-item and chunk */
#endif
#define KEEP_CHUNK (1U * KEEP_GROUP * KEEP_RUN)
#define KEEP_WORDS (KEEP_CHUNK / 32U)

/* What the work-items of a work-group share about a chunk of pairs. */
typedef struct {
  uint4 bytes[KEEP_CHUNK / sizeof(uint4)]; /* whether a pair is kept */
  uint bits[KEEP_WORDS];                   /* the same */
  uint before[KEEP_WORDS];                 /* kept pairs before those of a word of bits */
  uint kept, removed;                      /* where the chunk's pairs go in the two lists */
} keep_t;

/* Keeps the pairs of the last frame that are still pairs, and collects the others. Pairs of a chunk stay in order, so
   that those that were found together, and share boxes, remain neighbours. All work-items of a work-group must call
   it; the work is shared by `groups` work-groups, of which this is number `group`. (No `restrict`: Oclgrind 21.10 does
   not know what remains of it after inlining.) */
INLINE void keep_pairs(const keep_scalars_t* keep, global const uint2* last, global uint2* removed,
                       global const uint4* filters, global const uint2* exclusions, global const uint* stamps,
                       global const float* boxes, global const float8* ungrown, global uint2* pairs,
                       global uint* counts, const uint group, const uint groups, local keep_t* chunk) {
  const uint item = (uint)get_local_id(0);
  const uint end = last == 0 || is_halted(counts) ? 0U : last_found(counts);
  const uint last_kept = counts[COUNT_LAST_KEPT];
  for (uint first = group * KEEP_CHUNK; first < end; first += groups * KEEP_CHUNK) {
    uint2 pair[KEEP_RUN];
#pragma unroll
    for (uint i = 0; i < KEEP_RUN; ++i) {
      const uint k = i * KEEP_GROUP + item;
      uchar kept = 0;
      if (first + k < end) {
        pair[i] = list_pair(last, keep->last_capacity, first + k, last_kept);
        if (is_kept(pair[i], keep, boxes, ungrown, filters, exclusions, stamps)) kept = 1;
      }
      ((local uchar*)chunk->bytes)[k] = kept;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item < KEEP_WORDS) {
      chunk->bits[item] = bits_of_16(chunk->bytes[2U * item]) | bits_of_16(chunk->bytes[2U * item + 1U]) << 16;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    uint before_word = 0;
#pragma unroll 4
    for (uint word = 0; word < KEEP_WORDS; ++word) before_word += word < item ? popcount(chunk->bits[word]) : 0U;
    if (item < KEEP_WORDS) chunk->before[item] = before_word;
    barrier(CLK_LOCAL_MEM_FENCE);
    /* (Not before that barrier, where PoCL 3.1 does not enter a condition that follows the loop.) */
    if (item == 0U) {
      const uint kept = chunk->before[KEEP_WORDS - 1U] + popcount(chunk->bits[KEEP_WORDS - 1U]);
      const uint rest = min(KEEP_CHUNK, end - first) - kept;
      chunk->kept = kept == 0U ? 0U : atomic_add(&counts[COUNT_KEPT], kept);
      chunk->removed = rest == 0U ? 0U : atomic_add(&counts[COUNT_REMOVED], rest);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
    for (uint i = 0; i < KEEP_RUN; ++i) {
      const uint k = i * KEEP_GROUP + item;
      const uint bits = chunk->bits[k / 32U];
      const uint before = chunk->before[k / 32U] + popcount(bits & ((1U << k % 32U) - 1U));
      const bool kept = (bits >> k % 32U & 1U) != 0U;
      const uint at = kept ? chunk->kept + before : chunk->removed + k - before;
      if (first + k < end && kept && at < keep->capacity) pairs[at] = pair[i];
      if (first + k < end && !kept) removed[at] = pair[i];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
#endif

#endif
