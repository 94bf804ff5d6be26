/* Vectors of WIDTH lanes: on a GPU that many registers, on a CPU one. */
#ifndef BROADCL_LANES_H
#define BROADCL_LANES_H

#ifndef WIDTH
#define WIDTH 16 /* 4, 8 or 16 */
#endif

#define PASTE_(x, y) x##y
#define PASTE(x, y) PASTE_(x, y)
#define FLOATS PASTE(float, WIDTH)
#define INTS PASTE(int, WIDTH)

/* The same bound of WIDTH boxes that follow each other. */
#define BOUNDS_4(p) (p)[0], (p)[6], (p)[12], (p)[18]
#define BOUNDS_8(p) BOUNDS_4(p), BOUNDS_4((p) + 24)
#define BOUNDS_16(p) BOUNDS_8(p), BOUNDS_8((p) + 48)
#define BOUNDS(p) ((FLOATS)(PASTE(BOUNDS_, WIDTH)(p)))

/* A bit a lane, from lanes that are each 0 or -1. */
#define LANE_BITS_4 1, 2, 4, 8
#define LANE_BITS_8 LANE_BITS_4, 16, 32, 64, 128
#define LANE_BITS_16 LANE_BITS_8, 1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15
static inline uint lane_mask(const INTS lanes) {
  const INTS bits = lanes & (INTS)(PASTE(LANE_BITS_, WIDTH));
#if WIDTH == 16
  const int8 by_8 = bits.lo | bits.hi;
  const int4 by_4 = by_8.lo | by_8.hi;
#elif WIDTH == 8
  const int4 by_4 = bits.lo | bits.hi;
#else
  const int4 by_4 = bits;
#endif
  return (uint)(by_4.x | by_4.y | by_4.z | by_4.w);
}

#endif
