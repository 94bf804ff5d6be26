/* Filters as the host packs them: group, mask, body, world. */
#ifndef BROADCL_FILTER_H
#define BROADCL_FILTER_H

#define NO_BODY 0xffffffffU

/* Whether the filters of two objects let them pair: broadcl/filter.hpp. */
static inline bool may_pair(const uint4 s, const uint4 t) {
  return (s.x & t.y) != 0U && (t.x & s.y) != 0U && s.w == t.w && (s.z != t.z || s.z == NO_BODY);
}

#endif
