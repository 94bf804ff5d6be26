/* The keys by which boxes are sorted into tiles, and the tree over them: tiles.h.

   Boxes stay in their tiles for many frames. Bounds are computed in each frame, so results are exact; only the work
   grows as boxes of a tile move away from each other. The search counts its work for the host, which sorts again when
   the work has grown.

   Boxes are sorted along Hilbert's curve through a grid of 1024^3 cells (J. Skilling, "Programming the Hilbert curve",
   AIP Conference Proceedings 707, 2004). Unlike Morton's it never jumps: a tile across a jump would overlap half of the
   world. Boxes that are much larger than others come at the end, where they do not enlarge the bounds of small ones,
   and every tile visits them. If there are several worlds, each has a separate curve; objects of all worlds come last.
   */

#include "centroids.h"
#include "gather.h"
#include "inline.h"
#include "sizes.h"
#include "stamp.h"
#include "tiles.h"

#define KEEP_GROUP TILES_KEEP_GROUP
#define KEEP_RUN TILES_KEEP_RUN
#include "keep.h"

#define LARGE_CODE (1U << (CODE_BITS - 1))
#define EMPTY_CODE (2U * LARGE_CODE - 1U) /* which differs from LARGE_CODE in SORTED_BITS */

/* Index of a cell on Hilbert's curve. */
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

/* Elements to sort: slot, and key. `bounds` are those of centroids.cl. */
kernel void tiles_keys(const uint n, global const float* restrict boxes, global const uint4* restrict filters,
                       const uint buckets, global const uint* restrict bounds, global uint2* restrict elements) {
  const uint k = (uint)get_global_id(0);
  if (k >= n) return;
  global const float* box = boxes + (size_t)k * AABB_FLOATS;
  const uint bucket = filters == 0 ? 0U : bucket_of_world(filters[k].w, buckets);
  float corner[3];
  float longest = 0;
  for (uint i = 0; i < 3U; ++i) {
    corner[i] = -from_ordered(bounds[CENTROID_WORDS * bucket + i]);
    longest = max(longest, from_ordered(bounds[CENTROID_WORDS * bucket + 3U + i]) - corner[i]);
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

/* Replaces the keys by worlds and sets, to sort by these next. Objects of all worlds come last. */
kernel void tiles_world_keys(const uint n, const uint sets, global const uint4* restrict filters,
                             global uint2* restrict elements) {
  const uint k = (uint)get_global_id(0);
  if (k < n) elements[k].y = last_world(filters[elements[k].x], sets);
}

/* Bounds of nothing. */
static inline void make_none(bounds_t* bounds) {
  for (uint i = 0; i < AABB_FLOATS; ++i) bounds->bound[i] = NAN;
  bounds->first_world = NO_FIRST_WORLD;
  bounds->last_world = NO_LAST_WORLD;
}

/* Makes the bounds of nothing those of an object. */
static inline void make_bounds(bounds_t* bounds, const box_t* box, const uint slot, const bool worlds, const uint sets,
                               global const uint4* filters) {
  for (uint i = 0; i < AABB_FLOATS; ++i) bounds->bound[i] = box->bound[i];
  if (!worlds || isnan(box->bound[0])) return;
  bounds->first_world = first_world(filters[slot], sets);
  bounds->last_world = last_world(filters[slot], sets);
}

/* What bound i adds to a sum that is positive if bounds have grown to more than twice the length, over all axes. */
static inline float growth(const uint i, const float last, const float now) {
  return i < 3U ? 2.0F * last - now : now - 2.0F * last;
}

#if GROUP > 1
#define FOR_EACH_CHILD(child) const uint child = (uint)get_local_id(0);

#define WORDS 8U                      /* six bounds, and two worlds */
#define PART (NODE / (GROUP / WORDS)) /* children that a work-item merges */

typedef struct {
  uint words[WORDS][NODE + 1U];
  uint parts[WORDS][GROUP / WORDS];
  float growth[AABB_FLOATS];
} refit_t;

/* Bounds as words, such that the larger word is the wider bound, and 0 is no bound. */
static inline uint word_of_lower(const float bound) {
  return isnan(bound) ? 0U : ~ordered(bound);
}
static inline uint word_of_upper(const float bound) {
  return isnan(bound) ? 0U : ordered(bound);
}

/* Merges the bounds of all children of node k of a level, one per work-item, and stores them as child k of the level
   above. Unless `counts` is null, counts it if these have grown. All work-items must call it; `item` is a work-item's
   index among those of its node. */
INLINE void refit(const bounds_t* mine, const uint item, local refit_t* scratch, global float* tree, const uint k,
                  const uint parents, const bool worlds, global uint* counts) {
  for (uint i = 0; i < 3U; ++i) {
    scratch->words[i][item] = word_of_lower(mine->bound[i]);
    scratch->words[i + 3U][item] = word_of_upper(mine->bound[i + 3U]);
  }
  scratch->words[FIRST_WORLD][item] = ~mine->first_world;
  scratch->words[LAST_WORLD][item] = mine->last_world;
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint word = item % WORDS;
  const uint part = item / WORDS;
  uint widest = 0;
  for (uint i = 0; i < PART; ++i) widest = max(widest, scratch->words[word][part * PART + i]);
  scratch->parts[word][part] = widest;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (part == 0U && word < BOUNDS_OF_CHILD(worlds)) {
    for (uint i = 1; i < GROUP / WORDS; ++i) widest = max(widest, scratch->parts[word][i]);
    const size_t at = child_at(parents + k / NODE, word, k % NODE, worlds);
    const uint value = word < 3U || word == FIRST_WORLD ? ~widest : widest;
    if (word < AABB_FLOATS) {
      scratch->growth[word] = growth(word, tree[at], from_ordered(value));
      tree[at] = from_ordered(value);
    } else {
      ((global uint*)tree)[at] = value;
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  if (item > 0U || counts == 0) return;
  float sum = 0;
  for (uint i = 0; i < AABB_FLOATS; ++i) sum += scratch->growth[i];
  if (sum > 0) atomic_inc(&counts[COUNT_GROWN]);
}
#else
#define FOR_EACH_CHILD(child) for (uint child = 0; child < NODE; ++child)

/* Computes the bounds of the children of node k of a level, which are child k of the level above; those of none if
   there is no such node. Unless `counts` is null, counts it if these have grown. */
static inline void refit(global float* tree, const uint start, const uint k, const bool exists, const uint parents,
                         const bool worlds, global uint* counts) {
  float sum = 0;
  for (uint i = 0; i < AABB_FLOATS; ++i) {
    float bound = NAN;
    for (uint child = 0; exists && child < NODE; ++child) {
      const float other = tree[child_at(start + k, i, child, worlds)];
#if FLUSHES
      const bool is_wider =
          NOT_ABOVE(other, other) != 0 && (i < 3U ? NOT_ABOVE(bound, other) : NOT_ABOVE(other, bound)) == 0;
      bound = is_wider ? other : bound;
#else
      bound = i < 3U ? fmin(bound, other) : fmax(bound, other);
#endif
    }
    const size_t at = child_at(parents + k / NODE, i, k % NODE, worlds);
    sum += growth(i, tree[at], bound);
    tree[at] = bound;
  }
  if (counts != 0 && sum > 0) atomic_inc(&counts[COUNT_GROWN]);
  if (!worlds) return;
  global uint* words = (global uint*)tree;
  uint first = NO_FIRST_WORLD;
  uint last = NO_LAST_WORLD;
  for (uint child = 0; exists && child < NODE; ++child) {
    first = min(first, words[child_at(start + k, FIRST_WORLD, child, worlds)]);
    last = max(last, words[child_at(start + k, LAST_WORLD, child, worlds)]);
  }
  words[child_at(parents + k / NODE, FIRST_WORLD, k % NODE, worlds)] = first;
  words[child_at(parents + k / NODE, LAST_WORLD, k % NODE, worlds)] = last;
}
#endif

/* Copies the boxes to their tiles and computes the bounds of these, one work-group per tile. Tiles past the last one
   have no bounds. Work-groups with index 1 in dimension 1 do so for the tree of boxes that changed, `changed`. Unless
   `source` is null, objects are gathered from there. If `since` is not 0, it is the stamp of the frame of which the
   trees have the boxes; work-groups of one then leave out tiles that have not changed. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_fill(
    const uint n, const uint tiles, const uint parents, const uint worlds, const uint sets,
    global const uint2* restrict elements, global float* all, global float* changed, const uint stamp, const uint since,
    global const uint* restrict stamps, GATHER_PARAMETERS) {
  const uint tile = (uint)get_group_id(0);
  const bool some = get_group_id(1) > 0;
  global float* tree = some ? changed : all;
#if GROUP > 1
  local refit_t scratch;
#endif
  bool is_current = GROUP == 1 && since > 0U;
  for (uint place = tile * NODE; is_current && place < min(n, (tile + 1U) * NODE); ++place) {
    is_current = stamps[elements[place].x] >> 1 < since;
  }
  if (is_current) return;
  FOR_EACH_CHILD(child) {
    const uint place = tile * NODE + child;
    const uint slot = place < n ? elements[place].x : 0U;
    bounds_t bounds;
    make_none(&bounds);
    if (place < n && (!some || is_changed(stamps[slot], stamp))) {
      box_t box;
      if (source != 0) {
        gather_object(&box, slot, source, offset, stride, first_count, second, second_offset, second_stride,
                      source_filters, boxes, filters, counts);
      } else {
        load_box(&box, boxes, slot);
      }
      make_bounds(&bounds, &box, slot, worlds != 0U, sets, filters);
    }
    if (tile < tiles) store_child(&bounds, tree, tile, child, worlds != 0U);
#if GROUP > 1
    refit(&bounds, child, &scratch, tree, tile, parents, worlds != 0U, some ? 0 : counts);
#endif
  }
#if GROUP == 1
  refit(tree, 0, tile, tile < tiles, parents, worlds != 0U, some ? 0 : counts);
#endif
}

/* Computes the bounds of a level's nodes, for the level above, one work-group per node; of both trees as above. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void tiles_refit(
    const uint start, const uint nodes, const uint parents, const uint worlds, global float* all,
    global float* changed) {
  const uint k = (uint)get_group_id(0);
  global float* tree = get_group_id(1) > 0 ? changed : all;
#if GROUP > 1
  local refit_t scratch;
  bounds_t bounds;
  const uint item = (uint)get_local_id(0);
  make_none(&bounds);
  if (k < nodes) load_child(&bounds, tree, start + k, item, worlds != 0U);
  refit(&bounds, item, &scratch, tree, k, parents, worlds != 0U, 0);
#else
  refit(tree, start, k, k < nodes, parents, worlds != 0U, 0);
#endif
}

#if GROUP > 1
#define KEEP_NODES (KEEP_GROUP / GROUP) /* nodes per work-group */

/* The same, and keeps the pairs of the last frame, which saves a launch: the first work-groups compute bounds, and the
   others keep pairs. */
kernel __attribute__((reqd_work_group_size(KEEP_GROUP, 1, 1))) void tiles_refit_and_keep(
    const uint start, const uint nodes, const uint parents, const uint worlds, global float* all, global float* changed,
    KEEP_KERNEL_PARAMETERS) {
  local refit_t scratch[KEEP_NODES];
  local keep_t chunk;
  const uint group = (uint)get_group_id(0);
  const uint per_tree = (nodes + NODE - 1U) / NODE * NODE / KEEP_NODES;
  const uint refitting = changed == 0 ? per_tree : 2U * per_tree;
  if (group < refitting) {
    global float* tree = group < per_tree ? all : changed;
    const uint node = (uint)get_local_id(0) / GROUP;
    const uint item = (uint)get_local_id(0) % GROUP;
    const uint k = group % per_tree * KEEP_NODES + node;
    bounds_t bounds;
    make_none(&bounds);
    if (k < nodes) load_child(&bounds, tree, start + k, item, worlds != 0U);
    refit(&bounds, item, &scratch[node], tree, k, parents, worlds != 0U, 0);
  } else {
    keep_pairs(&keep_scalars, last, removed, keep_filters, keep_exclusions, keep_stamps, boxes, ungrown, pairs, counts,
               group - refitting, (uint)get_num_groups(0) - refitting, &chunk);
  }
}
#endif
