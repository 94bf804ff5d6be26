/* The search of tiles by work-groups of one work-item, which is for CPUs: tiles_search.cl. A vector instruction tests
   several children of a node. */

#include "tiles_walk.h"

#if GROUP == 1
#define FLUSH 64U /* hits are appended once there are this many */

/* Bits of the children of a node that the tile has to visit. */
static inline mask_t visit(const uint node, global const float* tree, global const float* changed,
                           const target_t* target, const bool worlds) {
  if (changed == 0) return overlapping(tree, node, &target->all, worlds);
  return overlapping(changed, node, &target->all, worlds) | overlapping(tree, node, &target->changed, worlds);
}

static inline void append_hits(const pair_sink_t* sink, local const uint2* hits, const uint count) {
  if (count == 0U) return;
  const uint base = reserve_pairs(sink, count);
  for (uint k = 0; k < count; ++k) append_pair(sink, base, k, hits[k]);
}

/* Tests the boxes of the tile against a box, the child of a node, and appends the new pairs to the hits; returns their
   number. */
static inline uint test_box(local uint2* hits, uint found, const uint tile, const uint node, const uint child,
                            const bool worlds, const uint sets, global const float* tree, global const uint2* elements,
                            local const box_t* own_last, global const uint4* filters, global const uint2* exclusions,
                            const pair_sink_t* sink) {
  bounds_t box;
  load_child(&box, tree, node, child, worlds);
  to_target(&box, sets);
  const uint slot = elements[node * NODE + child].x;
  mask_t own = overlapping(tree, tile, &box, worlds);
  if (node == tile) own &= ((mask_t)1 << child) - 1U;
  if (own == 0U) return found;
  box_t other_last;
  load_last_box(&other_last, sink, slot);
  for (; own != 0U; own &= own - 1U) {
    const uint mine = LOWEST_BIT(own);
    const uint my_slot = elements[tile * NODE + mine].x;
    const uint2 pair = pair_of(my_slot, slot);
    const box_t mine_last = own_last[mine];
    if (is_new_pair(pair, &mine_last, &other_last, filters, exclusions, sink)) hits[found++] = pair;
  }
  return found;
}

/* Finds the pairs of a tile with itself and later ones. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_search(TILES_SEARCH_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  const bool worlds = HAS_WORLDS;
  const uint tile = (uint)get_group_id(0);
  target_t target;
  load_target(&target, tree, SOME_CHANGED, scalars.starts[1] + tile / NODE, tile % NODE, worlds, scalars.sets);
  if (isnan(target.all.bound[0])) return; /* only free slots */
  const uint parts = is_dense(tree, tile, &target.all, worlds) ? (uint)get_num_groups(1) : scalars.workers;
  if ((uint)get_group_id(1) >= parts) return;
  const mask_t share = every_bit(parts);

  local uint2 hits[FLUSH + NODE];
  local box_t own_last[NODE];
  uint found = 0;
  for (uint child = 0; child < NODE; ++child) {
    box_t box;
    load_last_box(&box, &sink, elements[tile * NODE + child].x);
    own_last[child] = box;
  }

  uint work = 0; /* nodes and candidates */
  walk_t walk;
  rest_t rest;
  start_walk(&walk, &rest, tile, scalars.top);
  const uint end = is_halted(counts) || counts[COUNT_GROWN] > scalars.most_grown ? 0U : scalars.roots;
  while (walk.root < end) {
    mask_t bits = visit(start_of(&scalars, walk.level) + walk.node, tree, SOME_CHANGED, &target, worlds);
    ++work;
    if (walk.level > 0U) {
      bits = not_before(bits, walk.node, tile >> (NODE_BITS * (walk.level - 1U)));
      if (walk.level == 1U) bits &= share << (uint)get_group_id(1);
      set_rest(&rest, walk.level, bits);
    } else {
      work += (uint)popcount(bits);
      for (; bits != 0U; bits &= bits - 1U) {
        found = test_box(hits, found, tile, walk.node, LOWEST_BIT(bits), worlds, scalars.sets, tree, elements, own_last,
                         filters, exclusions, &sink);
        if (found < FLUSH) continue;
        append_hits(&sink, hits, found);
        found = 0;
      }
    }
    walk_on(&walk, &rest, scalars.top);
    if (work >= REPORTED_WORK) {
      if (atomic_add(&counts[COUNT_WORK], work) + work > scalars.most_work) walk.root = end;
      work = 0;
    }
  }
  append_hits(&sink, hits, found);
  atomic_add(&counts[COUNT_WORK], work);
}
#endif
