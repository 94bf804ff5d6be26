/* The search of tiles: tiles.h. Each tile searches the tree, from itself on, for what overlaps its own bounds, so each
   pair is found once. If not all boxes changed, there is a second tree of those that did: a tile searches the second
   tree with its bounds, and the first tree with the bounds of its own boxes that changed. Boxes that did not change are
   not tested against each other. */

#include "bits.h"
#include "delta.h"
#include "tiles.h"
#include "vote.h"

#ifndef SOME_CHANGED
#define SOME_CHANGED 0 /* 1 if not all boxes changed: there is a second tree, of those that did */
#endif

/* The children of a node, one bit each, that do not precede a given node of their level. */
static inline mask_t not_before(const mask_t bits, const uint node, const uint first) {
  const uint child = node * NODE;
  return first <= child ? bits : first - child < NODE ? bits & (~(mask_t)0 << (first - child)) : 0U;
}

/* The vector component of a level; component 0 is for the tiles. */
static inline uint of_level(const uint4 values, const uint level) {
  return level == 0U ? values.x : level == 1U ? values.y : level == 2U ? values.z : values.w;
}

/* By level, children of the nodes on the way down that are still to be visited. */
#if GROUP > 1
/* (Not an array, because a GPU stores an array in memory if its index varies.) */
typedef masks_t rest_t;
static inline mask_t rest_of(const rest_t* rest, const uint level) {
  const rest_t all = *rest;
  return level == 0U ? all.x : level == 1U ? all.y : level == 2U ? all.z : all.w;
}
static inline void set_rest(rest_t* rest, const uint level, const mask_t children) {
  if (level == 0U) rest->x = children;
  if (level == 1U) rest->y = children;
  if (level == 2U) rest->z = children;
  if (level == 3U) rest->w = children;
}
#else
/* (An array, because llvmpipe in Mesa 22.3 loses pairs with the code above.) */
typedef struct {
  mask_t children[TREE_LEVELS];
} rest_t;
static inline mask_t rest_of(const rest_t* rest, const uint level) {
  return rest->children[level];
}
static inline void set_rest(rest_t* rest, const uint level, const mask_t children) {
  rest->children[level] = children;
}
#endif

/* Whether two slots whose boxes overlap are a new pair; `s` and `t` are their boxes of the last frame. */
static inline bool is_new_pair(const uint2 pair, const box_t* s, const box_t* t, global const uint4* filters,
                               global const uint2* exclusions, const pair_sink_t* sink) {
  if (filters != 0 && !may_pair(filters[pair.x], filters[pair.y])) return false;
  if (is_excluded(pair, exclusions)) return false;
  /* (Branches, because Oclgrind 21.10 evaluates some negated conditions as true.) */
  if (boxes_overlap(s, t) && could_pair(sink, pair)) return false;
  return true;
}

/* Turns bounds into the bounds to search for: with two sets, those of the other set of the same world. (An interval of
   several sets is extended to all sets of its worlds.) */
static inline void seek(bounds_t* bounds, const uint sets) {
#if WORLDS
  const bool is_one = bounds->first_world == bounds->last_world;
  bounds->first_world = is_one ? bounds->first_world ^ sets : bounds->first_world & ~sets;
  bounds->last_world = is_one ? bounds->last_world ^ sets : bounds->last_world | sets;
#else
  (void)bounds;
  (void)sets;
#endif
}

/* One bit per child of a node: whether it overlaps these bounds. */
static inline mask_t overlapping(global const float* tree, const uint node, const bounds_t* bounds) {
  mask_t bits = 0;
#if GROUP > 1
#pragma unroll 1 /* more would take too many registers */
#endif
  for (uint part = 0; part < NODE / WIDTH; ++part) {
    global const float* p = tree + child_at(node, 0, part * WIDTH);
#define LOAD(i) PASTE(vload, WIDTH)(0, p + (i)*NODE)
    INTS overlap = AABB_OVERLAPS_LANES(
        LOAD(0), LOAD(1), LOAD(2), LOAD(3), LOAD(4), LOAD(5), bounds->bound[0], bounds->bound[1], bounds->bound[2],
        bounds->bound[3], bounds->bound[4], bounds->bound[5]);
#if WORLDS
    global const uint* worlds = (global const uint*)p;
    overlap &= (PASTE(vload, WIDTH)(0, worlds + FIRST_WORLD * NODE) <= bounds->last_world) &
               (PASTE(vload, WIDTH)(0, worlds + LAST_WORLD * NODE) >= bounds->first_world);
#endif
    bits |= (mask_t)lane_mask(overlap) << (part * WIDTH);
  }
  return bits;
}

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
#if WORLDS
  uint2 worlds[BATCH + NODE];
#endif
  uint slots[BATCH + NODE];
  uint2 hits[HITS]; /* an own box, and a slot; those that are new pairs become pairs */
  uint found;
  uint found_new;
  uint base;
  uint tested;   /* candidates, by this work-group, that are not in the total yet */
  uint all_work; /* the total when this work-group last added to it */
} search_t;

/* Bits of the children of a node that the tile has to visit, and this work-item's child. All work-items must call
   it. */
INLINE mask_t visit(const uint node, global const float* tree, const bounds_t* bounds, global const float* changed,
                    const bounds_t* changed_bounds, bounds_t* child, local ballots_t* ballots, uint* turn) {
  bool overlaps = false;
#if SOME_CHANGED
  load_child(child, changed, node, (uint)get_local_id(0));
  overlaps = bounds_overlap(child, bounds);
  load_child(child, tree, node, (uint)get_local_id(0));
  overlaps = overlaps || bounds_overlap(child, changed_bounds);
#else
  (void)changed;
  (void)changed_bounds;
  load_child(child, tree, node, (uint)get_local_id(0));
  overlaps = bounds_overlap(child, bounds);
#endif
  return vote(overlaps, ballots, turn);
}
#define VISIT(node) visit(node, tree, &bounds, changed, &changed_bounds, &child, &scratch.ballots, &turn)

/* If more than half of the children of a node overlap the bounds of a tile, its boxes may be far apart, because the
   order leaps where the scene has a gap. Then most of the bounds is empty, and this returns those of the children, in
   `bits`, that overlap a box of the tile; `child` is this work-item's. (Otherwise the few work-groups with such tiles
   would work long after all others.) All work-items must call it. */
INLINE mask_t near_a_box(const mask_t bits, const bounds_t* child, global const float* tree, const uint tile,
                         const uint sets, local ballots_t* ballots, uint* turn) {
  bounds_t sought = *child;
  seek(&sought, sets);
  return bits & vote(overlapping(tree, tile, &sought) != 0U, ballots, turn);
}

/* Appends those hits that are new pairs: all of them if there was no box in the last frame. All work-items must call
   it. */
INLINE void append_new(local search_t* scratch, const uint count, global const uint4* filters,
                       global const uint2* exclusions, const pair_sink_t* sink) {
  const uint item = (uint)get_local_id(0);
  const bool all_new = sink->last_slots == 0U && filters == 0 && exclusions == 0;
  for (uint k = item; all_new && k < count; k += GROUP) {
    const uint2 hit = scratch->hits[k];
    const uint own = scratch->own_slots[hit.x];
    scratch->hits[k] = (uint2)(min(own, hit.y), max(own, hit.y));
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint first = 0; !all_new && first < count; first += GROUP) {
    const uint2 hit = scratch->hits[min(first + item, count - 1U)];
    const uint own = scratch->own_slots[hit.x];
    const uint2 pair = (uint2)(min(own, hit.y), max(own, hit.y));
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

/* Tests the candidates: all work-items compare each of them with their own boxes. Returns whether to give up, because
   all work-groups together have done more than `most_work`. All work-items must call it. */
INLINE bool test_candidates(local search_t* scratch, const uint count, const bounds_t* own, const uint place,
                            const uint most_work, global const uint4* filters, global const uint2* exclusions,
                            const pair_sink_t* sink) {
  if (get_local_id(0) == 0U) {
    scratch->tested += count;
    const uint news = scratch->tested;
    if (news >= REPORTED_WORK) {
      scratch->all_work = atomic_add(&sink->counts[COUNT_WORK], news) + news;
      scratch->tested = 0;
    }
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
#if WORLDS
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
#else
#define FLUSH 64U /* hits are appended once there are this many */

/* Bits of the children of a node that the tile has to visit. */
static inline mask_t visit(const uint node, global const float* tree, const bounds_t* bounds,
                           global const float* changed, const bounds_t* changed_bounds) {
#if SOME_CHANGED
  return overlapping(changed, node, bounds) | overlapping(tree, node, changed_bounds);
#else
  (void)changed;
  (void)changed_bounds;
  return overlapping(tree, node, bounds);
#endif
}
#define VISIT(node) visit(node, tree, &bounds, changed, &changed_bounds)

static inline void append_hits(const pair_sink_t* sink, local const uint2* hits, const uint count) {
  if (count == 0U) return;
  const uint base = reserve_pairs(sink, count);
  for (uint k = 0; k < count; ++k) append_pair(sink, base, k, hits[k]);
}
#endif

/* Whether boxes of the size of the first would fill half of the tile if they did not overlap. */
static inline bool is_dense(global const float* tree, const uint tile, const bounds_t* bounds) {
  bounds_t box;
  load_child(&box, tree, tile, 0);
  float volume = 2U * NODE;
  float space = 1;
  for (uint i = 0; i < 3U; ++i) {
    volume *= box.bound[i + 3U] - box.bound[i];
    space *= bounds->bound[i + 3U] - bounds->bound[i];
  }
  return volume >= space;
}

/* Every n-th bit, for n = 1, 2, 4 or 8. */
static inline mask_t every_bit(const uint n) {
  mask_t bits = (mask_t)0x0101010101010101UL;
  if (n < 8U) bits |= bits << 4;
  if (n < 4U) bits |= bits << 2;
  if (n < 2U) bits |= bits << 1;
  return bits;
}

/* Finds the pairs of a tile with itself and later ones. `changed` is the tree of the boxes that changed, or null if all
   did. `starts` are the first nodes of the levels, `top` is the level of which there are `roots` nodes. The index of a
   work-group in dimension 0 is a tile; the first `sharers` work-groups along dimension 1 share its search, or all of
   them if it is dense. Each visits, of the tiles below a node, one of as many. All give up if together they have done
   more than `most_work`. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_search(
    const uint4 starts, const uint top, const uint roots, const uint sharers, const uint most_work, const uint sets,
    global const float* restrict tree, global const float* restrict changed, global const uint2* restrict elements,
    global const uint4* restrict filters, global const uint2* restrict exclusions, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  const uint tile = (uint)get_group_id(0);
  bounds_t bounds;
  load_child(&bounds, tree, starts.y + tile / NODE, tile % NODE);
  /* (Also if all take part: a condition for that would multiply the time that PoCL takes to compile this: inline.h.) */
  const uint parts = is_dense(tree, tile, &bounds) ? (uint)get_num_groups(1) : sharers;
  if ((uint)get_group_id(1) >= parts) return;
  const mask_t share = every_bit(parts);
  seek(&bounds, sets);
  bounds_t changed_bounds;
#if SOME_CHANGED
  load_child(&changed_bounds, changed, starts.y + tile / NODE, tile % NODE);
  seek(&changed_bounds, sets);
#else
  changed_bounds = bounds;
#endif

#if GROUP > 1
  local search_t scratch;
  const uint item = (uint)get_local_id(0);
  const uint own_place = tile * NODE + item;
  const uint own_slot = elements[own_place].x;
  bounds_t own;
  load_child(&own, tree, tile, item);
  seek(&own, sets);
  box_t own_last;
  load_last_box(&own_last, &sink, own_slot);
  scratch.own_last[item] = own_last;
  scratch.own_slots[item] = own_slot;
  if (item == 0U) scratch.found = scratch.found_new = scratch.tested = scratch.all_work = 0;
  uint turn = 0;
  uint count = 0; /* of candidates */
  bounds_t child;
#else
  local uint2 hits[FLUSH + NODE];
  local box_t own_last[NODE];
  uint found = 0;
  for (uint child = 0; child < NODE; ++child) {
    box_t box;
    load_last_box(&box, &sink, elements[tile * NODE + child].x);
    own_last[child] = box;
  }
#endif

  uint work = 0; /* nodes, and candidates unless they are counted in `tested` */
  rest_t rest;
  for (uint k = 0; k < TREE_LEVELS; ++k) set_rest(&rest, k, 0);
  uint level = top;
  const uint end = is_halted(counts) ? 0U : roots;
  uint root = tile >> (NODE_BITS * top);
  uint node = root;
  while (root < end) {
    mask_t bits = VISIT(of_level(starts, level) + node);
    ++work;
    if (level > 0U) {
      bits = not_before(bits, node, tile >> (NODE_BITS * (level - 1U)));
#if GROUP > 1
      if ((uint)popcount(bits) > NODE / 2U) bits = near_a_box(bits, &child, tree, tile, sets, &scratch.ballots, &turn);
#endif
      if (level == 1U) bits &= share << (uint)get_group_id(1);
      set_rest(&rest, level, bits);
    } else {
#if GROUP > 1
      if ((bits >> item & 1U) != 0U) {
        const uint k = count + (uint)popcount(bits & (((mask_t)1 << item) - 1U));
        const uint place = node * NODE + item;
        scratch.lower[k] = (float4)(child.bound[0], child.bound[1], child.bound[2], as_float(place));
        scratch.upper[k] = (float4)(child.bound[3], child.bound[4], child.bound[5], 0.0F);
#if WORLDS
        scratch.worlds[k] = (uint2)(child.first_world, child.last_world);
#endif
        scratch.slots[k] = elements[place].x;
      }
      count += (uint)popcount(bits);
#else
      work += (uint)popcount(bits);
      for (; bits != 0U; bits &= bits - 1U) {
        const uint child = LOWEST_BIT(bits);
        bounds_t box;
        load_child(&box, tree, node, child);
        seek(&box, sets);
        const uint slot = elements[node * NODE + child].x;
        mask_t own = overlapping(tree, tile, &box);
        if (node == tile) own &= ((mask_t)1 << child) - 1U;
        if (own == 0U) continue;
        box_t other_last;
        load_last_box(&other_last, &sink, slot);
        for (; own != 0U; own &= own - 1U) {
          const uint mine = LOWEST_BIT(own);
          const uint my_slot = elements[tile * NODE + mine].x;
          const uint2 pair = (uint2)(min(my_slot, slot), max(my_slot, slot));
          const box_t mine_last = own_last[mine];
          if (is_new_pair(pair, &mine_last, &other_last, filters, exclusions, &sink)) hits[found++] = pair;
        }
        if (found < FLUSH) continue;
        append_hits(&sink, hits, found);
        found = 0;
      }
#endif
    }

    while (level <= top && rest_of(&rest, level) == 0U) {
      ++level;
      node /= NODE;
    }
    if (level > top) {
      level = top;
      node = ++root;
    } else {
      const mask_t children = rest_of(&rest, level);
      node = node * NODE + LOWEST_BIT(children);
      set_rest(&rest, level, children & (children - 1U));
      --level;
    }
#if GROUP > 1
    if (count > BATCH || root >= end) {
      if (test_candidates(&scratch, count, &own, own_place, most_work, filters, exclusions, &sink)) root = end;
      count = 0;
    }
#else
    if (work >= REPORTED_WORK) {
      if (atomic_add(&counts[COUNT_WORK], work) + work > most_work) root = end;
      work = 0;
    }
#endif
  }

#if GROUP > 1
  /* (A halted frame has passed no barrier since the first work-item cleared what this reads.) */
  if (work > 0U) append_new(&scratch, scratch.found, filters, exclusions, &sink);
  if (item == 0U) atomic_add(&sink.counts[COUNT_WORK], work + scratch.tested);
#else
  append_hits(&sink, hits, found);
  atomic_add(&sink.counts[COUNT_WORK], work);
#endif
}
