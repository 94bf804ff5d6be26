/* The new pairs of a frame that was searched before its boxes were uploaded. The search was of the boxes of the last
   frame, enlarged by a margin, and found the near pairs: those that overlap so, but did not overlap in the last frame.
   If no box has left its enlarged one since then, all new pairs are among them. */

#include "delta.h"
#include "sizes.h"

#define CHUNK 4U /* near pairs per work-item that are tested at a time */

/* Enlarges a box by a margin on all sides. */
static inline void grow_box(box_t* box, const float margin) {
  for (uint i = 0; i < 3U; ++i) {
    box->bound[i] -= margin;
    box->bound[i + 3U] += margin;
  }
}

/* Enlarges the boxes of the last frame, one work-item per box, and sets the counts of near pairs to 0. */
kernel void near_pairs_grow(const uint slots, global const float* restrict boxes, const float margin,
                            global float* restrict grown, global uint* restrict near_counts) {
  const uint k = (uint)get_global_id(0);
  if (k < COUNTS) near_counts[k] = 0;
  if (k >= slots) return;
  box_t box;
  load_box(&box, boxes, k);
  grow_box(&box, margin);
  for (uint i = 0; i < AABB_FLOATS; ++i) grown[(size_t)k * AABB_FLOATS + i] = box.bound[i];
}

/* How far the sides of a box have moved outwards, at most, as the bits of a float that is not negative, and not -0:
   their order is that of the numbers. More than the margin if the box has left its enlarged one, however the difference
   is rounded. */
static inline uint displacement(const box_t* last, const box_t* now, const float margin) {
  box_t grown = *last;
  grow_box(&grown, margin);
  float farthest = 0;
  bool within = true;
  for (uint i = 0; i < 3U; ++i) {
    const float down = last->bound[i] - now->bound[i];
    const float up = now->bound[i + 3U] - last->bound[i + 3U];
    if (down > farthest) farthest = down;
    if (up > farthest) farthest = up;
    within = within && NOT_ABOVE(grown.bound[i], now->bound[i]) != 0 &&
             NOT_ABOVE(now->bound[i + 3U], grown.bound[i + 3U]) != 0;
  }
  if (isnan(now->bound[0])) return 0;
  if (isnan(last->bound[0])) return as_uint(INFINITY);
  return max(as_uint(farthest) & INT_MAX, within ? 0U : as_uint(margin) + 1U);
}

/* Measures how far boxes have moved, and appends the new pairs. `near_pairs` is the list of near pairs, filled from its
   end; `near_counts` are its counts, or null if there was no such search. If the list was too short, the displacement
   is TOO_MANY_NEAR. */
kernel void near_pairs_test(const uint slots, global const float* restrict boxes, const float margin,
                            const uint near_capacity, global const uint2* restrict near_pairs,
                            global const uint* restrict near_counts, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  local uint2 hits[NEAR_GROUP * CHUNK];
  local uint found;
  local uint base;
  local uint farthest;
  const uint item = (uint)get_local_id(0);
  const uint items = (uint)get_local_size(0);
  if (item == 0U) found = farthest = 0;
  uint mine = 0;
  for (uint k = (uint)get_global_id(0); k < slots; k += (uint)get_global_size(0)) {
    box_t last;
    box_t now;
    load_box(&last, last_boxes, k);
    load_box(&now, boxes, k);
    mine = max(mine, displacement(&last, &now, margin));
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  atomic_max(&farthest, mine);
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint count = near_counts == 0 ? 0U : near_counts[COUNT_ADDED];
  const bool all_near = near_counts == 0 || (count <= near_capacity && near_counts[COUNT_ADDED_HIGH] == 0U);
  if (item == 0U) atomic_max(&counts[COUNT_DISPLACEMENT], all_near ? farthest : TOO_MANY_NEAR);
  if (get_global_id(0) == 0 && near_counts != 0) atomic_add(&counts[COUNT_WORK], near_counts[COUNT_WORK]);

  const uint end = all_near ? count : 0U;
  const uint chunk = items * CHUNK;
  for (uint first = (uint)get_group_id(0) * chunk; first < end; first += (uint)get_num_groups(0) * chunk) {
    for (uint i = 0; i < CHUNK; ++i) {
      const uint k = first + i * items + item;
      if (k < end) {
        const uint2 pair = near_pairs[near_capacity - 1U - k];
        box_t s;
        box_t t;
        load_box(&s, boxes, pair.x);
        load_box(&t, boxes, pair.y);
        if (boxes_overlap(&s, &t) && are_within_reach(ungrown, pair)) hits[atomic_inc(&found)] = pair;
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    append_pairs(&sink, hits, found, items, &base);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0U) found = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
