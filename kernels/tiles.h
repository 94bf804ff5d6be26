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
/* The words of a child in a tree with worlds, or without. */
#define BOUNDS_OF_CHILD(worlds) (0U + ((worlds) ? CHILD_WORDS_OF_WORLDS : CHILD_WORDS))
#define FIRST_WORLD 6U /* after the floats, as uints */
#define LAST_WORLD 7U

/* Bounds of a child: of a box, or of all boxes below a node. NaN, and no world, if there is no child. In a tree without
   worlds, every child is in all of them. */
typedef struct {
  float bound[AABB_FLOATS];
  uint first_world, last_world;
} bounds_t;

/* The place of a word of a child: a node has lower x of all children, then lower y, ... */
static inline size_t child_at(const uint node, const uint bound, const uint child, const bool worlds) {
  return (size_t)node * (NODE * BOUNDS_OF_CHILD(worlds)) + bound * NODE + child;
}

static inline void load_child(bounds_t* bounds, global const float* tree, const uint node, const uint child,
                              const bool worlds) {
  for (uint i = 0; i < AABB_FLOATS; ++i) bounds->bound[i] = tree[child_at(node, i, child, worlds)];
  bounds->first_world = 0;
  bounds->last_world = UINT_MAX;
  if (worlds) {
    bounds->first_world = ((global const uint*)tree)[child_at(node, FIRST_WORLD, child, worlds)];
    bounds->last_world = ((global const uint*)tree)[child_at(node, LAST_WORLD, child, worlds)];
  }
}

static inline void store_child(const bounds_t* bounds, global float* tree, const uint node, const uint child,
                               const bool worlds) {
  for (uint i = 0; i < AABB_FLOATS; ++i) tree[child_at(node, i, child, worlds)] = bounds->bound[i];
  if (worlds) {
    ((global uint*)tree)[child_at(node, FIRST_WORLD, child, worlds)] = bounds->first_world;
    ((global uint*)tree)[child_at(node, LAST_WORLD, child, worlds)] = bounds->last_world;
  }
}

static inline bool bounds_overlap(const bounds_t* s, const bounds_t* t) {
  const int overlap = AABB_OVERLAPS(s->bound[0], s->bound[1], s->bound[2], s->bound[3], s->bound[4], s->bound[5],
                                    t->bound[0], t->bound[1], t->bound[2], t->bound[3], t->bound[4], t->bound[5]);
  return (overlap & (s->first_world <= t->last_world) & (t->first_world <= s->last_world)) != 0;
}

#endif
