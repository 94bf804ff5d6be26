/* Filters, as the host stores them: group, mask, body, world. */
#ifndef BROADCL_FILTER_H
#define BROADCL_FILTER_H

#include "pair.h"

#define NO_BODY 0xffffffffU
#define ALL_WORLDS 0xffffffffU

/* Whether objects of two worlds may pair. */
static inline bool worlds_meet(const uint s, const uint t) {
  return s == t || s == ALL_WORLDS || t == ALL_WORLDS;
}

/* Worlds as intervals, which overlap if objects may pair: the interval of an object, and that of nothing. If `sets` is
   1, the lowest bit of the group divides the objects of each world into two sets, and only pairs of one object of each
   are found: an interval then has to overlap the interval of the other set, which tiles_walk.h computes. Otherwise
   `sets` is 0. (Worlds that have the same number here are distinguished by may_pair().) */
static inline uint first_world(const uint4 filter, const uint sets) {
  if (filter.w == ALL_WORLDS) return 0;
  return sets == 0U ? filter.w : filter.w << 1 | (sets & ~filter.x);
}
static inline uint last_world(const uint4 filter, const uint sets) {
  return filter.w == ALL_WORLDS ? 0xffffffffU : first_world(filter, sets);
}
#define NO_FIRST_WORLD 0xffffffffU
#define NO_LAST_WORLD 0U

/* Whether the filters of two objects let them pair: broadcl/filter.hpp. */
static inline bool may_pair(const uint4 s, const uint4 t) {
  return (s.x & t.y) != 0U && (t.x & s.y) != 0U && worlds_meet(s.w, t.w) && (s.z != t.z || s.z == NO_BODY);
}

/* Whether a pair is in a list of exclusions: the list has their number, then pairs in canonical order. Null if there
   are none. */
static inline bool is_excluded(const uint2 pair, global const uint2* exclusions) {
  if (exclusions == 0) return false;
  uint begin = 1;
  uint end = exclusions[0].x + 1U;
  while (begin < end) {
    const uint middle = begin + (end - begin) / 2U;
    const ulong other = key_of_pair(exclusions[middle]);
    if (other == key_of_pair(pair)) return true;
    if (other < key_of_pair(pair)) {
      begin = middle + 1U;
    } else {
      end = middle;
    }
  }
  return false;
}

#endif
