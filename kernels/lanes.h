/* Vectors of WIDTH lanes: WIDTH registers on a GPU, one on a CPU. */
#ifndef BROADCL_LANES_H
#define BROADCL_LANES_H

#include "aabb.h"

#ifndef WIDTH
#define WIDTH 16 /* 4 or 16 */
#endif

#define PASTE_(x, y) x##y
#define PASTE(x, y) PASTE_(x, y)
#define FLOATS PASTE(float, WIDTH)
#define INTS PASTE(int, WIDTH)
#define AS_INTS PASTE(as_int, WIDTH)
#define AS_FLOATS PASTE(as_float, WIDTH)

/* The same bound of WIDTH consecutive boxes. */
#define BOUNDS_4(p) (p)[0], (p)[6], (p)[12], (p)[18]
#define BOUNDS_8(p) BOUNDS_4(p), BOUNDS_4((p) + 24)
#define BOUNDS_16(p) BOUNDS_8(p), BOUNDS_8((p) + 48)
#define BOUNDS(p) ((FLOATS)(PASTE(BOUNDS_, WIDTH)(p)))

/* The worlds of WIDTH consecutive objects, from their filters. */
#define WORLD_OF_4(p) (int)(p)[0].w, (int)(p)[1].w, (int)(p)[2].w, (int)(p)[3].w
#define WORLD_OF_8(p) WORLD_OF_4(p), WORLD_OF_4((p) + 4)
#define WORLD_OF_16(p) WORLD_OF_8(p), WORLD_OF_8((p) + 8)
#define WORLD_OF(p) ((INTS)(PASTE(WORLD_OF_, WIDTH)(p)))

/* Like NOT_ABOVE and AABB_OVERLAPS, for vectors and values that are the same in all lanes: 0 or -1 per lane. */
#if FLUSHES
static inline INTS not_above_lanes(const FLOATS s, const FLOATS t) {
  const INTS x = select(AS_INTS(s), INT_MIN - AS_INTS(s), AS_INTS(s));
  const INTS y = select(AS_INTS(t), INT_MIN - AS_INTS(t), AS_INTS(t));
  return (x <= y) & (x >= -as_int(INFINITY)) & (y <= as_int(INFINITY));
}
#define NOT_ABOVE_LANES(s, t) not_above_lanes((FLOATS)(s), (FLOATS)(t))
#else
#define NOT_ABOVE_LANES(s, t) ((s) <= (t))
#endif
#define AABB_OVERLAPS_LANES(s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y, \
                            t_lower_z, t_upper_x, t_upper_y, t_upper_z)                                             \
  AABB_OVERLAPS_BY(NOT_ABOVE_LANES, s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x,    \
                   t_lower_y, t_lower_z, t_upper_x, t_upper_y, t_upper_z)

/* One bit per lane, from lanes that are 0 or -1. */
#define LANE_BITS_4 1, 2, 4, 8
#define LANE_BITS_8 LANE_BITS_4, 16, 32, 64, 128
#define LANE_BITS_16 LANE_BITS_8, 1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15
#define LANE_BITS ((INTS)(PASTE(LANE_BITS_, WIDTH)))
static inline uint lane_mask(const INTS lanes) {
  const INTS bits = lanes & LANE_BITS;
#if WIDTH == 16
  const int8 by_8 = bits.lo | bits.hi;
  const int4 by_4 = by_8.lo | by_8.hi;
#else
  const int4 by_4 = bits;
#endif
  return (uint)(by_4.x | by_4.y | by_4.z | by_4.w);
}

#endif
