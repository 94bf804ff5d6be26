/* Tiles: the boxes are sorted so that neighbours in space are mostly neighbours, 32 boxes per tile, under a tree
   of bounds in which every node has 32 children; 64 of both on GPUs that run 64 work-items in step. Objects in
   different worlds never pair, so if there are several worlds, boxes are sorted by world first, and the bounds of a
   node have a fourth dimension, its worlds.

   Levels of the tree are stored one after the other. Children of the nodes of level 0, which are the tiles, are boxes;
   those of the nodes of level 1 are bounds of tiles, and so on. */
#ifndef BROADCL_TILES_H
#define BROADCL_TILES_H

#include "aabb.h"
#include "filter.h"
#include "sizes.h"

#ifndef GROUP
#define GROUP 32 /* one work-item per child, 32 or 64; 1 with the tuning for CPUs: it handles all children */
#endif
#if GROUP > 1
#define WIDTH 4 /* vectors take registers there */
#endif
#include "lanes.h"
#ifndef WORLDS
#define WORLDS 0 /* 1 if objects are in different worlds */
#endif

/* Number of children of a node, and of boxes of a tile, which count as children, too. A mask has one bit for each. */
#define NODE (0U + CHILDREN_OF(GROUP))
#if NODE == 64
#define NODE_BITS 6U
typedef ulong mask_t;
typedef ulong4 masks_t; /* one per level */
#else
#define NODE_BITS 5U
typedef uint mask_t;
typedef uint4 masks_t;
#endif
#define BOUNDS_OF_CHILD (0U + (WORLDS ? CHILD_WORDS_OF_WORLDS : CHILD_WORDS))
#define NODE_WORDS (NODE * BOUNDS_OF_CHILD) /* lower x of all children, then lower y, ... */
#define FIRST_WORLD 6U                      /* after the floats, as uints */
#define LAST_WORLD 7U

/* Bounds of a child: of a box, or of all boxes below a node. NaN, and no world, if there is no child. */
typedef struct {
  float bound[AABB_FLOATS];
#if WORLDS
  uint first_world, last_world;
#endif
} bounds_t;

static inline size_t child_at(const uint node, const uint bound, const uint child) {
  return (size_t)node * NODE_WORDS + bound * NODE + child;
}

static inline void load_child(bounds_t* bounds, global const float* tree, const uint node, const uint child) {
  for (uint i = 0; i < AABB_FLOATS; ++i) bounds->bound[i] = tree[child_at(node, i, child)];
#if WORLDS
  bounds->first_world = ((global const uint*)tree)[child_at(node, FIRST_WORLD, child)];
  bounds->last_world = ((global const uint*)tree)[child_at(node, LAST_WORLD, child)];
#endif
}

static inline void store_child(const bounds_t* bounds, global float* tree, const uint node, const uint child) {
  for (uint i = 0; i < AABB_FLOATS; ++i) tree[child_at(node, i, child)] = bounds->bound[i];
#if WORLDS
  ((global uint*)tree)[child_at(node, FIRST_WORLD, child)] = bounds->first_world;
  ((global uint*)tree)[child_at(node, LAST_WORLD, child)] = bounds->last_world;
#endif
}

static inline bool bounds_overlap(const bounds_t* s, const bounds_t* t) {
  int overlap = AABB_OVERLAPS(s->bound[0], s->bound[1], s->bound[2], s->bound[3], s->bound[4], s->bound[5], t->bound[0],
                              t->bound[1], t->bound[2], t->bound[3], t->bound[4], t->bound[5]);
#if WORLDS
  overlap &= (s->first_world <= t->last_world) & (t->first_world <= s->last_world);
#endif
  return overlap != 0;
}

#endif
