/* GPU-BF: tests every pair of boxes and stores one byte per pair, 1 if they overlap.

   After Serpa and Rodrigues, "Parallelizing Broad Phase Collision Detection for Animation in Games: A Performance
   Comparison of CPU and GPU Algorithms", SBGames 2014. In the paper a work-item tests one pair and stores one byte;
   here it tests WIDTH consecutive pairs of a row and stores them as one aligned word, and does so for several rows
   in which its words begin at the same `a`, so that it reads its WIDTH boxes once. */

#include "aabb.h"
#include "distance.h"
#include "filter.h"
#include "lanes.h"
#include "triangle.h"

#ifndef __ENDIAN_LITTLE__
#error "the bytes of a word are packed for little-endian devices"
#endif

#define PERIOD row_period(WIDTH)

/* A word of WIDTH bytes, each 0 or 1, from WIDTH lanes, each 0 or -1. Packed by hand because compilers for GPUs store
   vectors of bytes byte by byte. */
#define BYTE_BITS_4 1, 1 << 8, 1 << 16, 1 << 24
#define BYTE_BITS_8 BYTE_BITS_4, BYTE_BITS_4
#define BYTE_BITS_16 BYTE_BITS_8, BYTE_BITS_8
#define BYTE_BITS ((INTS)(PASTE(BYTE_BITS_, WIDTH)))
#if WIDTH == 4
typedef int word_t;
#define PACK(bits) ((bits).s0 | (bits).s1 | (bits).s2 | (bits).s3)
#else
typedef int4 word_t;
#define PACK(bits) ((bits).s048c | (bits).s159d | (bits).s26ae | (bits).s37bf)
#endif

/* Clears the lanes of those pairs (a, b), (a + 1, b), ... that are none, although boxes overlap. */
INTS filter_lanes(const INTS lanes, global const uint4* restrict filters, global const float8* restrict ungrown,
                  const uint a, const uint b) {
  if (!any(lanes)) return lanes;
  uint allowed = filters == 0 ? UINT_MAX : 0U;
  for (uint lane = 0; filters != 0 && lane < WIDTH; ++lane) {
    allowed |= may_pair(filters[a + lane], filters[b]) ? 1U << lane : 0U;
  }
#pragma unroll 1
  for (uint lane = 0; ungrown != 0 && lane < WIDTH; ++lane) {
    if (!are_within_reach(ungrown, (uint2)(a + lane, b))) allowed &= ~(1U << lane);
  }
  return select((INTS)(0), lanes, ((INTS)((int)allowed) & LANE_BITS) != 0);
}

/* A seam: the last pairs of row b - 1, then the first pairs of row b, and perhaps of later rows. Bytes after the last
   row n - 1 become 0. */
void test_seam(const uint b, const uint n, global const float* restrict boxes, global const uint4* restrict filters,
               global const float8* restrict ungrown, global uint* restrict words) {
  const ulong seam = row_start(b) - row_start(b) % WIDTH;
  uint s = (uint)(seam - row_start(b - 1U));
  uint t = b - 1U;
  for (uint word = 0; word < WIDTH / 4U; ++word) {
    uint packed = 0;
#pragma unroll 1
    for (uint k = 0; k < 4U; ++k, ++s) {
      if (s == t) {
        s = 0;
        ++t;
      }
      if (t < n) {
        global const float* p = boxes + (size_t)s * AABB_FLOATS;
        global const float* q = boxes + (size_t)t * AABB_FLOATS;
        uint hit = (uint)AABB_OVERLAPS(p[0], p[1], p[2], p[3], p[4], p[5], q[0], q[1], q[2], q[3], q[4], q[5]);
        if (hit != 0U && filters != 0) hit = may_pair(filters[s], filters[t]) ? 1U : 0U;
        if (hit != 0U) hit = are_within_reach(ungrown, (uint2)(s, t)) ? 1U : 0U;
        packed |= hit << (8U * k);
      }
    }
    words[seam / 4U + word] = packed;
  }
}

/* Clears the bytes of exclusions (filter.h) among the first n objects, `count` of them, one work-item each. */
kernel void gpu_bf_exclude(const uint count, const uint n, global const uint2* restrict exclusions,
                           global uchar* restrict bytes) {
  const uint k = (uint)get_global_id(0);
  if (k >= count) return;
  const uint2 pair = exclusions[k + 1U];
  if (pair.y < n) bytes[row_start(pair.y) + pair.x] = 0;
}

/* The index in dimension 0 is a word of a row. The index in dimension 1, from `first` on, is a class of rows (b modulo
   PERIOD) and a chunk of `rows` rows of that class; from PERIOD * chunks on, it is a seam, for n work-items in all. */
kernel void gpu_bf(const uint n, const uint rows, const uint chunks, const uint first,
                   global const float* restrict boxes, global const uint4* restrict filters,
                   global const float8* restrict ungrown, global word_t* restrict words) {
  const uint x = (uint)get_global_id(0);
  const uint y = first + (uint)get_global_id(1);
  if (y >= PERIOD * chunks) {
    const uint b = (y - PERIOD * chunks) * (uint)get_global_size(0) + x + 1U;
    if (b <= n && owns_seam(b, WIDTH)) test_seam(b, n, boxes, filters, ungrown, (global uint*)words);
    return;
  }

  const uint row_class = y % PERIOD;
  const uint chunk = y / PERIOD;
  const uint a = (uint)row_head(row_class, WIDTH) + x * WIDTH;
  const uint end = min(n, (chunk + 1U) * rows * PERIOD);
  /* The first row of this class and chunk that is long enough for the word: b >= a + WIDTH. */
  uint b = row_class + chunk * rows * PERIOD;
  if (b < a + WIDTH) b += (a + WIDTH - b + PERIOD - 1U) / PERIOD * PERIOD;
  if (b >= end) return;

  global const float* p = boxes + (size_t)a * AABB_FLOATS;
  const FLOATS lower_x = BOUNDS(p);
  const FLOATS lower_y = BOUNDS(p + 1);
  const FLOATS lower_z = BOUNDS(p + 2);
  const FLOATS upper_x = BOUNDS(p + 3);
  const FLOATS upper_y = BOUNDS(p + 4);
  const FLOATS upper_z = BOUNDS(p + 5);
  for (; b < end; b += PERIOD) {
    global const float* q = boxes + (size_t)b * AABB_FLOATS;
    INTS lanes =
        AABB_OVERLAPS_LANES(lower_x, lower_y, lower_z, upper_x, upper_y, upper_z, q[0], q[1], q[2], q[3], q[4], q[5]);
    if (filters != 0 || ungrown != 0) lanes = filter_lanes(lanes, filters, ungrown, a, b);
    const INTS bits = BYTE_BITS & lanes;
    words[(row_start(b) + a) / WIDTH] = PACK(bits);
  }
}
