/* Sizes by which the host allocates memory and launches kernels. Valid OpenCL C and C++, so that host and kernels use
   the same ones. */
#ifndef BROADCL_SIZES_H
#define BROADCL_SIZES_H

/* Children of a node of tiles.h, by the number of work-items per work-group. */
#define CHILDREN_OF(group) ((group) > 1 ? (group) : 32)

/* Pairs per work-item of delta.cl, likewise. */
#define DELTA_RUN_OF(group) ((group) > 1 ? 4 : 256)

enum {
  CENTROID_WORDS = 6, /* of the bounds of the centroids, per bucket: centroids.cl */

  /* tiles.h */
  TREE_LEVELS = 4,
  CHILD_WORDS = 6,           /* the bounds of a child */
  CHILD_WORDS_OF_WORLDS = 8, /* the same with its worlds */

  /* tiles_build.cl */
  AXIS_BITS = 10,                /* of a cell's index along an axis */
  CODE_BITS = 3 * AXIS_BITS + 1, /* of the keys by which boxes are sorted */
  SORTED_BITS = 24,              /* the highest of them: one radix pass less than for all, and trees as good */
  TILES_KEEP_GROUP = 256,        /* work-items per work-group that keeps pairs */
  TILES_KEEP_RUN = 4,            /* pairs of each */

  /* tiles_search.cl */
  REPORTED_WORK = 256, /* what a work-group does before it adds that to the total */

  /* near_pairs.cl */
  NEAR_GROUP = 256, /* work-items per work-group, at most */

  /* order_small.cl */
  ORDER_RANGE = 64 /* changes that a work-group sorts in one launch, on average */
};

#endif
