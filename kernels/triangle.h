/* The triangle of pairs (a, b), a < b, laid out row by row: row b holds a = 0 .. b-1, so pair (a, b) has the dense
   index b(b-1)/2 + a, which does not depend on the number of boxes.

   Results are stored in words of WIDTH consecutive pairs. A word either lies within one row or is a seam, in which
   at least one row starts after the word's first byte. Valid OpenCL C and C++: the host sizes launches with it. */
#ifndef BROADCL_TRIANGLE_H
#define BROADCL_TRIANGLE_H

/* Index of the first pair of row b. */
static inline ulong row_start(uint b) {
  const ulong row = b;
  return row * (b - 1U) / 2U;
}

/* The starts of rows this far apart are the same modulo WIDTH. */
static inline uint row_period(uint width) {
  return 2U * width;
}

/* Pairs at the start of row b that share a word with the row before; WIDTH a power of two. */
static inline ulong row_head(uint b, uint width) {
  return (0U - row_start(b)) & (width - 1U);
}

/* Whether row b >= 1 is the first to start inside a seam, after the seam's first byte. Row n, which is past the last
   one, owns the word that the last row leaves incomplete. */
static inline bool owns_seam(uint b, uint width) {
  const ulong start = row_start(b);
  const ulong seam = start - start % width;
  return start != seam && row_start(b - 1U) <= seam;
}

#endif
