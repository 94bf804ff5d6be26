/* What both kernels that search tiles have in common: what a tile searches for, and its walk through the tree. */
#ifndef BROADCL_TILES_WALK_H
#define BROADCL_TILES_WALK_H

#include "bits.h"
#include "delta.h"
#include "tiles.h"

#ifndef GENERAL
/* 0 for one world without reaches, all of whose boxes changed, which takes a GPU fewer registers. */
#define GENERAL (GROUP == 1)
#endif
#define HAS_WORLDS (GENERAL && scalars.worlds != 0U)
#define SOME_CHANGED (GENERAL ? changed : 0) /* the tree of the boxes that changed, or null if all did */

/* `changed` is the tree of the boxes that changed, or null if all did. The index of a work-group in dimension 0 is a
   tile; the first `workers` work-groups along dimension 1 share its search, or all of them if it is dense. Each visits,
   of the tiles below a node, one of as many. All give up if together they have done more than `most_work`. */
#define TILES_SEARCH_PARAMETERS                                                                                  \
  const tiles_search_scalars_t scalars, global const float *restrict tree, global const float *restrict changed, \
      global const uint2 *restrict elements, global const uint4 *restrict filters,                               \
      global const uint2 *restrict exclusions, PAIR_SINK_PARAMETERS

/* The children of a node, one bit each, that do not precede a given node of their level. */
static inline mask_t not_before(const mask_t bits, const uint node, const uint first) {
  const uint child = node * NODE;
  return first <= child ? bits : first - child < NODE ? bits & (~(mask_t)0 << (first - child)) : 0U;
}

/* The first node of a level. (Not by the level as an index, because a GPU would store the array in memory.) */
static inline uint start_of(const tiles_search_scalars_t* scalars, const uint level) {
  return level == 0U   ? scalars->starts[0]
         : level == 1U ? scalars->starts[1]
         : level == 2U ? scalars->starts[2]
                       : scalars->starts[3];
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
  if (GENERAL && !are_within_reach(sink->ungrown, pair)) return false;
  /* (Branches, because Oclgrind 21.10 evaluates some negated conditions as true.) */
  if (boxes_overlap(s, t) && (!GENERAL || are_within_reach(sink->last_ungrown, pair)) && could_pair(sink, pair)) {
    return false;
  }
  return true;
}

/* Turns bounds into the bounds to search for: with two sets, those of the other set of the same world. (An interval of
   several sets is extended to all sets of its worlds.) */
static inline void to_target(bounds_t* bounds, const uint sets) {
  const bool is_one = bounds->first_world == bounds->last_world;
  bounds->first_world = is_one ? bounds->first_world ^ sets : bounds->first_world & ~sets;
  bounds->last_world = is_one ? bounds->last_world ^ sets : bounds->last_world | sets;
}

/* One bit per child of a node: whether it overlaps these bounds. */
static inline mask_t overlapping(global const float* tree, const uint node, const bounds_t* bounds, const bool worlds) {
  mask_t bits = 0;
#if GROUP > 1
#pragma unroll 1 /* more would take too many registers */
#endif
  for (uint part = 0; part < NODE / WIDTH; ++part) {
    global const float* p = tree + child_at(node, 0, part * WIDTH, worlds);
#define LOAD(i) PASTE(vload, WIDTH)(0, p + (i)*NODE)
    INTS overlap = AABB_OVERLAPS_LANES(
        LOAD(0), LOAD(1), LOAD(2), LOAD(3), LOAD(4), LOAD(5), bounds->bound[0], bounds->bound[1], bounds->bound[2],
        bounds->bound[3], bounds->bound[4], bounds->bound[5]);
    if (worlds) {
      global const uint* words = (global const uint*)p;
      overlap &= (PASTE(vload, WIDTH)(0, words + FIRST_WORLD * NODE) <= bounds->last_world) &
                 (PASTE(vload, WIDTH)(0, words + LAST_WORLD * NODE) >= bounds->first_world);
    }
    bits |= (mask_t)lane_mask(overlap) << (part * WIDTH);
  }
  return bits;
}

/* The bounds that a tile searches for: those of all its boxes, and of those that changed. */
typedef struct {
  bounds_t all;
  bounds_t changed; /* not set if all did */
} target_t;

/* `node` and `child` are those of the tile. */
static inline void load_target(target_t* target, global const float* tree, global const float* changed, const uint node,
                               const uint child, const bool worlds, const uint sets) {
  load_child(&target->all, tree, node, child, worlds);
  to_target(&target->all, sets);
  if (changed == 0) return;
  load_child(&target->changed, changed, node, child, worlds);
  to_target(&target->changed, sets);
}

/* Where a walk through the tree is, and below which root node. (Without a rest_t, because an array among them would put
   all of them in memory.) */
typedef struct {
  uint level, root, node;
} walk_t;

static inline void start_walk(walk_t* walk, rest_t* rest, const uint tile, const uint top) {
  for (uint k = 0; k < TREE_LEVELS; ++k) set_rest(rest, k, 0);
  walk->level = top;
  walk->root = tile >> (NODE_BITS * top);
  walk->node = walk->root;
}

/* Goes to the next node that is still to be visited, or to the next root node. */
static inline void walk_on(walk_t* walk, rest_t* rest, const uint top) {
  while (walk->level <= top && rest_of(rest, walk->level) == 0U) {
    ++walk->level;
    walk->node /= NODE;
  }
  if (walk->level > top) {
    walk->level = top;
    walk->node = ++walk->root;
  } else {
    const mask_t children = rest_of(rest, walk->level);
    walk->node = walk->node * NODE + LOWEST_BIT(children);
    set_rest(rest, walk->level, children & (children - 1U));
    --walk->level;
  }
}

/* Whether boxes of the size of the first would fill half of the tile if they did not overlap. */
static inline bool is_dense(global const float* tree, const uint tile, const bounds_t* bounds, const bool worlds) {
  bounds_t box;
  load_child(&box, tree, tile, 0, worlds);
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

#endif
