/* The scalar arguments of kernels that have many arguments: one struct, passed by value, for each group of parameters.
   Valid OpenCL C and C++, and only words, so that host and kernels store them alike. */
#ifndef BROADCL_ARGUMENTS_H
#define BROADCL_ARGUMENTS_H

#include "sizes.h"

/* NOLINTBEGIN(modernize-use-using, modernize-avoid-c-arrays): C has neither. */

#define HAS_WORDS(type, words) typedef char type##_has_words[sizeof(type) == (words) * sizeof(uint) ? 1 : -1]

/* PAIR_SINK_PARAMETERS of delta.h. */
typedef struct {
  uint capacity;   /* of the list of this frame */
  uint last_slots; /* boxes of the last frame */
  uint stamp;      /* of this frame */
} sink_scalars_t;
HAS_WORDS(sink_scalars_t, 3);

/* KEEP_PARAMETERS of keep.h. */
typedef struct {
  uint last_capacity; /* of the list of the last frame */
  uint all;           /* 1 if all slots count as changed; if not, stamps tell which did */
  uint slots;         /* boxes of this frame */
  uint stamp;         /* of this frame */
  uint capacity;      /* of the list of this frame */
} keep_scalars_t;
HAS_WORDS(keep_scalars_t, 5);

/* brute_force.cl. */
typedef struct {
  uint n;         /* boxes */
  uint row_count; /* n if every slot is a row, and pairs are tested with a < b; otherwise rows are slots that changed */
  uint rows;      /* of a work-item */
  uint first_run; /* of rows, in this launch */
} brute_force_scalars_t;
HAS_WORDS(brute_force_scalars_t, 4);

/* TILES_SEARCH_PARAMETERS of tiles_walk.h. */
typedef struct {
  uint starts[TREE_LEVELS]; /* the first nodes of the levels */
  uint top;                 /* the level at which the search starts */
  uint roots;               /* its nodes */
  uint workers;             /* work-groups that share the search of a tile */
  uint most_work;           /* at which the search is given up */
  uint most_grown;          /* COUNT_GROWN at which it is not begun */
  uint worlds;              /* 1 if the trees have worlds */
  uint sets;                /* filter.h */
} tiles_search_scalars_t;
HAS_WORDS(tiles_search_scalars_t, TREE_LEVELS + 7U);

/* CHANGES_PARAMETERS of order.h. */
typedef struct {
  uint capacity;        /* of the list of pairs */
  uint list_capacity;   /* of each list of changes */
  uint total_capacity;  /* of both together */
  uint tag;             /* a number that the host chooses for the frame */
  uint buckets_of_list; /* these three are 0 in one launch */
  uint bucket_bits;
  uint worlds;
  uint second_set; /* its first slot, or 0 if there is no second set */
} order_scalars_t;
HAS_WORDS(order_scalars_t, 8);

/* NOLINTEND(modernize-use-using, modernize-avoid-c-arrays) */

#endif
