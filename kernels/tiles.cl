/* Tiles: the boxes stand in an order in which neighbours in space are mostly neighbours, 32 of them to a tile, under a tree
   of bounds in which every node has 32 children. Each tile searches the tree for what overlaps its own bounds, from itself
   on, so that each pair is found once. Where not all boxes changed, there is a second tree, of those that did: a tile searches
   it, and searches the first one for what overlaps the bounds of its own boxes that changed. What did not change since it
   was last tested is not tested again.

   The order may be an old one: bounds are made anew each frame, so that results are exact, and only the work grows as boxes
   move away from those they were put beside. The search counts its work for the host, which sorts when it has grown.

   The order is that of Hilbert's curve through a grid of 1024^3 cells (J. Skilling, "Programming the Hilbert curve", AIP
   Conference Proceedings 707, 2004). It never leaps, as Morton's does: a tile that lies across a leap would meet half of
   the world. Boxes much larger than others stand at the end, where they do not widen the bounds of small ones, and every
   tile meets them. */

#include "aabb.h"
#include "delta.h"
#include "centroids.h"
#include "filter.h"
#include "lanes.h"

#ifndef GROUP
#define GROUP 32 /* one work-item a child; 1 in the shape for CPUs, where it does all children */
#endif
/* For functions with barriers: PoCL 3.1 gives wrong results where one is called from two places and not inlined. */
#define INLINE static inline __attribute__((always_inline))

#ifndef SOME_CHANGED
#define SOME_CHANGED 0 /* 1 where not all boxes changed: the fill is that of the second tree then */
#endif

#define NODE 32U                        /* children of a node; boxes of a tile are a node's children too */
#define NODE_FLOATS (NODE * AABB_FLOATS) /* lower x of all children, then lower y, ... */
#define AXIS_BITS 10U
#define LARGE_CODE (1U << (3U * AXIS_BITS))
#define EMPTY_CODE (LARGE_CODE + 1U)
#define FLUSH 64U      /* hits that are worth being appended */
#define OWN 8U         /* boxes of a tile that are tested before hits are appended */
#define CANDIDATES 96U /* boxes that overlap a tile's bounds that are worth being tested */

/* Place of a cell on Hilbert's curve. */
static inline uint hilbert(uint cell[3]) {
  for (uint bit = 1U << (AXIS_BITS - 1U); bit > 1U; bit >>= 1) {
    const uint below = bit - 1U;
    for (uint i = 0; i < 3U; ++i) {
      const uint swapped = (cell[i] & bit) != 0U ? 0U : (cell[0] ^ cell[i]) & below;
      cell[0] ^= (cell[i] & bit) != 0U ? below : swapped;
      if (i > 0U) cell[i] ^= swapped;
    }
  }
  cell[1] ^= cell[0];
  cell[2] ^= cell[1];
  uint flips = 0;
  for (uint bit = 1U << (AXIS_BITS - 1U); bit > 1U; bit >>= 1) {
    if ((cell[2] & bit) != 0U) flips ^= bit - 1U;
  }
  uint code = 0;
  for (uint bit = AXIS_BITS; bit-- > 0U;) {
    for (uint i = 0; i < 3U; ++i) code = code << 1 | ((cell[i] ^ flips) >> bit & 1U);
  }
  return code;
}

/* Elements to sort: slot, and place in the order of space. */
kernel void tiles_keys(const uint n, global const float* restrict boxes, global const uint* restrict bounds,
                       global uint2* restrict elements) {
  const uint k = (uint)get_global_id(0);
  if (k >= n) return;
  global const float* box = boxes + (size_t)k * AABB_FLOATS;
  float corner[3];
  float longest = 0;
  for (uint i = 0; i < 3U; ++i) {
    corner[i] = from_ordered(bounds[i]);
    longest = max(longest, from_ordered(bounds[3 + i]) - corner[i]);
  }
  const float3 m = centroid(box);
  const float3 edges = vload3(1, box) - vload3(0, box);
  uint code = EMPTY_CODE;
  if (isnan(m.x) || !(max(edges.x, max(edges.y, edges.z)) <= longest * 0.125F)) {
    if (!isnan(box[0])) code = LARGE_CODE;
  } else {
    const float cells = (float)(1U << AXIS_BITS);
    const float place[3] = {m.x, m.y, m.z};
    uint cell[3];
    for (uint i = 0; i < 3U; ++i) {
      cell[i] = longest > 0 ? (uint)min((place[i] - corner[i]) / longest * cells, cells - 1.0F) : 0U;
    }
    code = hilbert(cell);
  }
  elements[k] = (uint2)(k, code);
}

/* Levels of the tree lie one behind the other. Children of the nodes of level 0, which are the tiles, are boxes; those of
   the nodes of level 1 are bounds of tiles, and so on. */
#define LEVELS 4U

static inline size_t child_at(const uint node, const uint bound, const uint child) {
  return (size_t)node * NODE_FLOATS + bound * NODE + child;
}

#if GROUP > 1
#define FOR_EACH_CHILD(child) const uint child = (uint)get_local_id(0);
#else
#define FOR_EACH_CHILD(child) for (uint child = 0; child < NODE; ++child)
#endif

/* Makes the bounds of the children of node k of a level, which are child k of the level above; NaNs where there is none. */
static inline void raise(global float* tree, const uint start, const uint k, const bool exists, const uint parents) {
  for (uint i = (uint)get_local_id(0); i < AABB_FLOATS; i += GROUP) {
    float bound = NAN;
    for (uint child = 0; exists && child < NODE; ++child) {
      const float other = tree[child_at(start + k, i, child)];
      bound = i < 3U ? fmin(bound, other) : fmax(bound, other);
    }
    tree[child_at(parents + k / NODE, i, k % NODE)] = bound;
  }
}

/* Puts the boxes into their tiles and makes the bounds of these; a work-group a tile. Tiles past the last one have no
   bounds. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_fill(
    const uint n, const uint tiles, const uint parents, global const float* restrict boxes,
    global const uint2* restrict elements, const uint stamp, global const uint* restrict stamps, global float* tree) {
#if !SOME_CHANGED
  (void)stamp;
  (void)stamps;
#endif
  const uint tile = (uint)get_group_id(0);
  if (tile < tiles) {
    FOR_EACH_CHILD(child) {
      const uint place = tile * NODE + child;
      const uint slot = place < n ? elements[place].x : 0U;
#if SOME_CHANGED
      const bool is_in = place < n && is_changed(stamps[slot], stamp);
#else
      const bool is_in = place < n;
#endif
      global const float* box = boxes + (size_t)slot * AABB_FLOATS;
      for (uint i = 0; i < AABB_FLOATS; ++i) tree[child_at(tile, i, child)] = is_in ? box[i] : NAN;
    }
  }
  barrier(CLK_GLOBAL_MEM_FENCE);
  raise(tree, 0, tile, tile < tiles, parents);
}

/* Makes the bounds of a level's nodes, for the level above; a work-group a node. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_raise(const uint start, const uint nodes,
                                                                          const uint parents, global float* tree) {
  const uint k = (uint)get_group_id(0);
  raise(tree, start, k, k < nodes, parents);
}

/* A bit a child of a node: which overlap a box. All work-items must call it. */
#if GROUP > 1
INLINE uint overlapping(global const float* tree, const uint node, const box_t* box, local uint* children) {
  global const float* p = tree + child_at(node, 0, (uint)get_local_id(0));
  const int hit = AABB_OVERLAPS(p[0], p[NODE], p[2 * NODE], p[3 * NODE], p[4 * NODE], p[5 * NODE], box->bound[0],
                                box->bound[1], box->bound[2], box->bound[3], box->bound[4], box->bound[5]);
  barrier(CLK_LOCAL_MEM_FENCE);
  if (get_local_id(0) == 0) *children = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (hit != 0) atomic_or(children, 1U << (uint)get_local_id(0));
  barrier(CLK_LOCAL_MEM_FENCE);
  return *children;
}
#else
INLINE uint overlapping(global const float* tree, const uint node, const box_t* box, local uint* children) {
  (void)children;
  uint bits = 0;
  for (uint part = 0; part < NODE / WIDTH; ++part) {
    global const float* p = tree + child_at(node, 0, part * WIDTH);
#define LOAD(i) PASTE(vload, WIDTH)(0, p + (i)*NODE)
    bits |= lane_mask(AABB_OVERLAPS(LOAD(0), LOAD(1), LOAD(2), LOAD(3), LOAD(4), LOAD(5), box->bound[0], box->bound[1],
                                    box->bound[2], box->bound[3], box->bound[4], box->bound[5]))
            << (part * WIDTH);
  }
  return bits;
}
#endif

/* Of the children of a node, a bit each, those that do not come before a node of their level. */
static inline uint not_before(const uint bits, const uint node, const uint first) {
  const uint child = node * NODE;
  return first <= child ? bits : first - child < NODE ? bits & (0xffffffffU << (first - child)) : 0U;
}

static inline uint lowest_bit(const uint bits) {
  return 31U - clz(bits & (0U - bits));
}

static inline box_t child_of(global const float* tree, const uint node, const uint child) {
  box_t box;
  for (uint i = 0; i < AABB_FLOATS; ++i) box.bound[i] = tree[child_at(node, i, child)];
  return box;
}

/* Whether two slots whose boxes overlap are a new pair; `s` and `t` are their boxes of the last frame. */
static inline bool is_new(const uint2 pair, const box_t* s, const box_t* t, global const uint4* filters,
                          const pair_sink_t* sink) {
  if (filters != 0 && !may_pair(filters[pair.x], filters[pair.y])) return false;
  return !boxes_overlap(s, t) || !could_pair(sink, pair);
}

/* Appends hits if they are many, or the last ones. All work-items must call it. */
INLINE void append_hits(const pair_sink_t* sink, local const uint2* hits, local uint* found, local uint* base,
                            const bool all) {
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint total = *found;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (total >= (all ? 1U : FLUSH)) {
    if (get_local_id(0) == 0) {
      *base = reserve_pairs(sink, total);
      *found = 0;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint k = (uint)get_local_id(0); k < total; k += GROUP) append_pair(sink, *base, k, hits[k]);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}

#if GROUP > 1
/* Boxes that overlap the bounds of a work-group's tile, to be tested against its boxes. */
typedef struct {
  box_t box;
  uint place, slot;
} candidate_t;

/* Tests candidates, one a work-item at a time. All work-items must call it. */
INLINE void test_candidates(local const candidate_t* candidates, const uint count, local const candidate_t* own,
                            local const box_t* own_last, global const uint4* filters,
                            const pair_sink_t* sink, local uint2* hits, local uint* found, local uint* base) {
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint first = 0; first < count; first += GROUP) {
    const uint k = min(first + (uint)get_local_id(0), count - 1U);
    const candidate_t other = candidates[k];
    box_t last;
    load_last_box(&last, sink, other.slot);
    for (uint part = 0; part < NODE; part += OWN) {
      for (uint i = part; i < part + OWN; ++i) {
        const candidate_t mine = own[i];
        if (k != first + (uint)get_local_id(0) || mine.place >= other.place || !boxes_overlap(&mine.box, &other.box)) {
          continue;
        }
        const uint2 pair = (uint2)(min(mine.slot, other.slot), max(mine.slot, other.slot));
        const box_t mine_last = own_last[i];
        if (is_new(pair, &mine_last, &last, filters, sink)) hits[atomic_inc(found)] = pair;
      }
      append_hits(sink, hits, found, base, false);
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}
#endif

/* Finds the pairs of a tile with itself and later ones. `changed` is the tree of the boxes that changed. `starts` are the first nodes of the levels, `roots` is the number of
   nodes of the last one. Work-groups of dimension 0 stand for a tile each; those of dimension 1 share its search: the
   tiles that the first of them visits are those whose bit is in `share`, among each 32, the next one's are one further. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_search(
    const uint4 starts, const uint roots, const uint share, global const float* restrict tree,
    global const float* restrict changed, global const uint2* restrict elements,
    global const uint4* restrict filters, PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
  const uint start_of[LEVELS] = {starts.x, starts.y, starts.z, starts.w};
  local uint2 hits[FLUSH + OWN * NODE];
  local box_t own_last[NODE];
  local uint children;
  local uint found;
  local uint base;
  const uint tile = (uint)get_group_id(0);
  const box_t bounds = child_of(tree, start_of[1] + tile / NODE, tile % NODE);
#if SOME_CHANGED
  const box_t changed_bounds = child_of(changed, start_of[1] + tile / NODE, tile % NODE);
#else
  (void)changed;
#endif
#if GROUP > 1
  local candidate_t own[NODE];
  local candidate_t candidates[CANDIDATES + NODE];
  const uint lane = (uint)get_local_id(0);
  const uint my_place = tile * NODE + lane;
  own[lane].box = child_of(tree, tile, lane);
  own[lane].place = my_place;
  own[lane].slot = elements[my_place].x;
  box_t mine;
  load_last_box(&mine, &sink, own[lane].slot);
  own_last[lane] = mine;
  uint count = 0;
#else
  for (uint child = 0; child < NODE; ++child) {
    box_t mine;
    load_last_box(&mine, &sink, elements[tile * NODE + child].x);
    own_last[child] = mine;
  }
#endif
  if (get_local_id(0) == 0) found = 0;

  uint work = 0;
  uint rest[LEVELS] = {0, 0, 0, 0}; /* children of the nodes on the way down that are still to be searched */
  uint level = LEVELS - 1U;
  uint root = tile / (NODE * NODE * NODE);
  uint node = root;
  while (root < roots) {
#if SOME_CHANGED
    uint bits = overlapping(changed, start_of[level] + node, &bounds, &children);
    bits |= overlapping(tree, start_of[level] + node, &changed_bounds, &children);
#else
    uint bits = overlapping(tree, start_of[level] + node, &bounds, &children);
#endif
    ++work;
    if (level > 0U) {
      if (level == 1U) bits &= share << (uint)get_group_id(1);
      rest[level] = not_before(bits, node, tile >> (5U * (level - 1U)));
    } else {
      work += popcount(bits);
#if GROUP > 1
      if ((bits >> lane & 1U) != 0U) {
        local candidate_t* candidate = &candidates[count + popcount(bits & ((1U << lane) - 1U))];
        candidate->box = child_of(tree, node, lane);
        candidate->place = node * NODE + lane;
        candidate->slot = elements[node * NODE + lane].x;
      }
      count += popcount(bits);
      if (count >= CANDIDATES) {
        test_candidates(candidates, count, own, own_last, filters, &sink, hits, &found, &base);
        count = 0;
      }
#else
      for (; bits != 0U; bits &= bits - 1U) {
        const uint child = lowest_bit(bits);
        const box_t box = child_of(tree, node, child);
        const uint slot = elements[node * NODE + child].x;
        uint own = overlapping(tree, tile, &box, &children);
        if (node == tile) own &= (1U << child) - 1U;
        if (own == 0U) continue;
        box_t last;
        load_last_box(&last, &sink, slot);
        for (; own != 0U; own &= own - 1U) {
          const uint mine = lowest_bit(own);
          const uint my_slot = elements[tile * NODE + mine].x;
          const uint2 pair = (uint2)(min(my_slot, slot), max(my_slot, slot));
          const box_t mine_last = own_last[mine];
          if (is_new(pair, &mine_last, &last, filters, &sink)) hits[found++] = pair;
        }
        append_hits(&sink, hits, &found, &base, false);
      }
#endif
    }

    while (level < LEVELS && rest[level] == 0U) {
      ++level;
      node /= NODE;
    }
    if (level == LEVELS) {
      level = LEVELS - 1U;
      node = ++root;
    } else {
      node = node * NODE + lowest_bit(rest[level]);
      rest[level] &= rest[level] - 1U;
      --level;
    }
  }

#if GROUP > 1
  test_candidates(candidates, count, own, own_last, filters, &sink, hits, &found, &base);
#endif
  append_hits(&sink, hits, &found, &base, true);
  if (get_local_id(0) == 0) atomic_add(&sink.counts[COUNT_WORK], work);
}
