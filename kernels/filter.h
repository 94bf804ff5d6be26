/* Filters as the host packs them: group, mask, body, world. */
#ifndef BROADCL_FILTER_H
#define BROADCL_FILTER_H

#define NO_BODY 0xffffffffU
#define ALL_WORLDS 0xffffffffU

/* Whether objects of two worlds may pair. */
static inline bool worlds_meet(const uint s, const uint t) {
  return s == t || s == ALL_WORLDS || t == ALL_WORLDS;
}

/* The same as intervals that overlap: those of a world, and of nothing. */
static inline uint first_world(const uint world) {
  return world == ALL_WORLDS ? 0U : world;
}
static inline uint last_world(const uint world) {
  return world;
}
#define NO_FIRST_WORLD 0xffffffffU
#define NO_LAST_WORLD 0U

/* Whether the filters of two objects let them pair: broadcl/filter.hpp. */
static inline bool may_pair(const uint4 s, const uint4 t) {
  return (s.x & t.y) != 0U && (t.x & s.y) != 0U && worlds_meet(s.w, t.w) && (s.z != t.z || s.z == NO_BODY);
}

#endif
