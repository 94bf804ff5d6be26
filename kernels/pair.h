/* A pair of slots: two words, of which the smaller comes first. Pairs are in canonical order by the second, then by the
   first, which is the order of their keys: of each pair as one number, with its first word in the lower bits. Valid
   OpenCL C and C++, so that host and kernels use the same bits. */
#ifndef BROADCL_PAIR_H
#define BROADCL_PAIR_H

enum { PAIR_FIRST_BIT = 0, PAIR_SECOND_BIT = 32 }; /* of the words in a key */

#ifndef __cplusplus
/* The pair of two different slots. */
static inline uint2 pair_of(const uint s, const uint t) {
  return (uint2)(min(s, t), max(s, t));
}

static inline ulong key_of_pair(const uint2 pair) {
  return (ulong)pair.y << PAIR_SECOND_BIT | pair.x;
}

static inline uint2 pair_of_key(const ulong key) {
  return (uint2)((uint)key, (uint)(key >> PAIR_SECOND_BIT));
}
#endif

#endif
