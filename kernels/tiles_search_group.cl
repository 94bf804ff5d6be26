/* The search of tiles by work-groups of one work-item per child, which is for GPUs: tiles_search.cl. All work-items
   walk through the tree together; each tests its child of a node, and its own box of the tile against the candidates.
 */

#include "inline.h"
#include "tiles_walk.h"
#include "vote.h"

#if GROUP > 1
#define BATCH 32U /* candidates that are tested at a time: a work-item has a bit for each */
/* Capacity for hits: the smaller it is, the more work-groups run at the same time on GPUs with waves of 64, which have
   64 KiB per compute unit. */
#define HITS (8192U / NODE)
#define ENOUGH (HITS / 2U) /* hits are compared with the last frame once there are this many */

typedef struct {
  ballots_t ballots;
  /* The boxes of the tile. */
  box_t own_last[NODE];
  uint own_slots[NODE];
  /* Boxes that overlap the bounds of the tile, with their indices in lower.w. */
  float4 lower[BATCH + NODE];
  float4 upper[BATCH + NODE];
#if GENERAL
  uint2 worlds[BATCH + NODE];
#endif
  uint slots[BATCH + NODE];
  uint2 hits[HITS]; /* an own box, and a slot; those that are new pairs become pairs */
  uint found;
  uint found_new;
  uint base;
  uint work;     /* nodes and candidates, by this work-group, that are not in the total yet */
  uint all_work; /* the total when this work-group last added to it */
} search_t;

/* Bits of the children of a node that the tile has to visit, and this work-item's child. All work-items must call
   it. */
INLINE mask_t visit(const uint node, global const float* tree, global const float* changed, const target_t* target,
                    const bool worlds, bounds_t* child, local ballots_t* ballots, uint* turn) {
  bool overlaps = false;
  if (changed != 0) {
    load_child(child, changed, node, (uint)get_local_id(0), worlds);
    overlaps = bounds_overlap(child, &target->all);
  }
  load_child(child, tree, node, (uint)get_local_id(0), worlds);
  overlaps = overlaps || bounds_overlap(child, changed == 0 ? &target->all : &target->changed);
  return vote(overlaps, ballots, turn);
}

/* If more than half of the children of a node overlap the bounds of a tile, its boxes may be far apart, because the
   curve leaps where the scene has a gap. Then most of the bounds is empty, and this returns those of the children, in
   `bits`, that overlap a box of the tile; `child` is this work-item's. (Otherwise the work-groups with such tiles
   would work long after all others.) All work-items must call it. */
INLINE mask_t near_a_box(const mask_t bits, const bounds_t* child, global const float* tree, const uint tile,
                         const bool worlds, const uint sets, local ballots_t* ballots, uint* turn) {
  bounds_t target = *child;
  to_target(&target, sets);
  return bits & vote(overlapping(tree, tile, &target, worlds) != 0U, ballots, turn);
}

/* Appends those hits that are new pairs: all of them if there was no box in the last frame. All work-items must call
   it. */
INLINE void append_new(local search_t* scratch, const uint count, global const uint4* filters,
                       global const uint2* exclusions, const pair_sink_t* sink) {
  const uint item = (uint)get_local_id(0);
  const bool all_new = sink->last_slots == 0U && filters == 0 && exclusions == 0 && sink->ungrown == 0;
  for (uint k = item; all_new && k < count; k += GROUP) {
    const uint2 hit = scratch->hits[k];
    const uint own = scratch->own_slots[hit.x];
    scratch->hits[k] = pair_of(own, hit.y);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint first = 0; !all_new && first < count; first += GROUP) {
    const uint2 hit = scratch->hits[min(first + item, count - 1U)];
    const uint own = scratch->own_slots[hit.x];
    const uint2 pair = pair_of(own, hit.y);
    const box_t own_last = scratch->own_last[hit.x];
    box_t last;
    load_last_box(&last, sink, hit.y);
    const bool is_new = first + item < count && is_new_pair(pair, &own_last, &last, filters, exclusions, sink);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (is_new) scratch->hits[atomic_inc(&scratch->found_new)] = pair;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  append_pairs(sink, scratch->hits, all_new ? count : scratch->found_new, GROUP, &scratch->base);
  barrier(CLK_LOCAL_MEM_FENCE);
  if (item == 0U) scratch->found = scratch->found_new = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
}

/* Tests the candidates, after a number of nodes: all work-items compare each of them with their own boxes. Returns
   whether to give up, because all work-groups together have done more than `most_work`. All work-items must call it. */
INLINE bool test_candidates(local search_t* scratch, const uint count, const uint nodes, const bounds_t* own,
                            const uint place, const uint most_work, global const uint4* filters,
                            global const uint2* exclusions, const pair_sink_t* sink) {
  if (get_local_id(0) == 0U) {
    const uint work = scratch->work + nodes + count;
    const bool reports = work >= REPORTED_WORK;
    if (reports) scratch->all_work = atomic_add(&sink->counts[COUNT_WORK], work) + work;
    scratch->work = reports ? 0U : work;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  const bool gives_up = scratch->all_work > most_work;
  for (uint first = 0; first < count; first += BATCH) {
    const uint size = min(BATCH, count - first);
    uint bits = 0;
#pragma unroll 4
    for (uint k = 0; k < size; ++k) {
      const float4 lower = scratch->lower[first + k];
      const float4 upper = scratch->upper[first + k];
      int hit = AABB_OVERLAPS(own->bound[0], own->bound[1], own->bound[2], own->bound[3], own->bound[4], own->bound[5],
                              lower.x, lower.y, lower.z, upper.x, upper.y, upper.z);
      hit &= place < as_uint(lower.w);
#if GENERAL
      const uint2 worlds = scratch->worlds[first + k];
      hit &= (own->first_world <= worlds.y) & (worlds.x <= own->last_world);
#endif
      bits |= (hit != 0 ? 1U : 0U) << k;
    }
    bool more = true;
    while (more) {
      uint k = bits == 0U ? 0U : atomic_add(&scratch->found, popcount(bits));
      for (; bits != 0U && k < HITS; bits &= bits - 1U) {
        scratch->hits[k++] = (uint2)((uint)get_local_id(0), scratch->slots[first + LOWEST_BIT(bits)]);
      }
      barrier(CLK_LOCAL_MEM_FENCE);
      const uint found = scratch->found;
      barrier(CLK_LOCAL_MEM_FENCE);
      if (found >= ENOUGH) append_new(scratch, min(found, HITS), filters, exclusions, sink);
      more = found > HITS;
    }
  }
  return gives_up;
}
/* Adds the children of a node that the tile has to visit, one bit each, to the candidates; `child` is this work-item's.
   Returns the number of candidates. */
static inline uint add_candidates(local search_t* scratch, const uint count, const mask_t bits, const bounds_t* child,
                                  const uint node, global const uint2* elements) {
  const uint item = (uint)get_local_id(0);
  if ((bits >> item & 1U) != 0U) {
    const uint k = count + (uint)popcount(bits & (((mask_t)1 << item) - 1U));
    const uint place = node * NODE + item;
    scratch->lower[k] = (float4)(child->bound[0], child->bound[1], child->bound[2], as_float(place));
    scratch->upper[k] = (float4)(child->bound[3], child->bound[4], child->bound[5], 0.0F);
#if GENERAL
    scratch->worlds[k] = (uint2)(child->first_world, child->last_world);
#endif
    scratch->slots[k] = elements[place].x;
  }
  return count + (uint)popcount(bits);
}

/* Finds the pairs of a tile with itself and later ones. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_search(TILES_SEARCH_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  const bool worlds = HAS_WORLDS;
  const uint tile = (uint)get_group_id(0);
  target_t target;
  load_target(&target, tree, SOME_CHANGED, scalars.starts[1] + tile / NODE, tile % NODE, worlds, scalars.sets);
  if (isnan(target.all.bound[0])) return; /* only free slots */
  /* (Also if all take part: a condition for that would multiply the time that PoCL takes to compile this: inline.h.) */
  const uint parts = is_dense(tree, tile, &target.all, worlds) ? (uint)get_num_groups(1) : scalars.workers;
  if ((uint)get_group_id(1) >= parts) return;
  const mask_t share = every_bit(parts);

  local search_t scratch;
  const uint item = (uint)get_local_id(0);
  const uint own_place = tile * NODE + item;
  const uint own_slot = elements[own_place].x;
  bounds_t own;
  load_child(&own, tree, tile, item, worlds);
  to_target(&own, scalars.sets);
  box_t own_last;
  load_last_box(&own_last, &sink, own_slot);
  scratch.own_last[item] = own_last;
  scratch.own_slots[item] = own_slot;
  if (item == 0U) scratch.found = scratch.found_new = scratch.work = scratch.all_work = 0;

  uint turn = 0;
  uint count = 0; /* of candidates */
  uint nodes = 0; /* since the last test */
  walk_t walk;
  rest_t rest;
  start_walk(&walk, &rest, tile, scalars.top);
  const uint end = is_halted(counts) || counts[COUNT_GROWN] > scalars.most_grown ? 0U : scalars.roots;
  while (walk.root < end) {
    bounds_t child;
    mask_t bits = visit(start_of(&scalars, walk.level) + walk.node, tree, SOME_CHANGED, &target, worlds, &child,
                        &scratch.ballots, &turn);
    ++nodes;
    if (walk.level > 0U) {
      bits = not_before(bits, walk.node, tile >> (NODE_BITS * (walk.level - 1U)));
      if ((uint)popcount(bits) > NODE / 2U) {
        bits = near_a_box(bits, &child, tree, tile, worlds, scalars.sets, &scratch.ballots, &turn);
      }
      if (walk.level == 1U) bits &= share << (uint)get_group_id(1);
      set_rest(&rest, walk.level, bits);
    } else {
      count = add_candidates(&scratch, count, bits, &child, walk.node, elements);
    }
    walk_on(&walk, &rest, scalars.top);
    if (count > BATCH || nodes >= REPORTED_WORK || walk.root >= end) {
      if (test_candidates(&scratch, count, nodes, &own, own_place, scalars.most_work, filters, exclusions, &sink)) {
        walk.root = end;
      }
      count = nodes = 0;
    }
  }
  /* (A halted frame has passed no barrier since the first work-item cleared what this reads.) */
  if (end > 0U) append_new(&scratch, scratch.found, filters, exclusions, &sink);
  if (item == 0U) atomic_add(&sink.counts[COUNT_WORK], scratch.work);
}
#endif
