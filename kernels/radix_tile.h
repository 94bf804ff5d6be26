/* A tile of a radix sort: the elements that a work-group holds at a time, and sorts by some of their bits. */
#ifndef BROADCL_RADIX_TILE_H
#define BROADCL_RADIX_TILE_H

#ifndef __ENDIAN_LITTLE__
#error "two uints are sorted as one number, which takes a little-endian device"
#endif

#include "inline.h"
#include "scan.h"

static inline uint digit_of(const ulong element, const uint first, const uint bits) {
  return (uint)(element >> first) & ((1U << bits) - 1U);
}

#ifndef TILE
#define TILE (GROUP > 1 ? 4096 : 1) /* a multiple of GROUP, and a power of two less than 2^16 */
#endif
#define VALUES (TILE / GROUP) /* elements per work-item */

/* The elements of the tile, GROUP apart. Those from `end` on have all bits set, so they come after all others. */
static inline void load_tile(ulong elements[VALUES], global const ulong* restrict source, const uint tile,
                             const uint end) {
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) {
    const uint place = tile + k * GROUP + (uint)get_local_id(0);
    elements[k] = place < end ? source[place] : ~0UL;
  }
}

#if GROUP > 1
#define RANK_BITS 4
#define COUNTERS (1 << (RANK_BITS - 1)) /* words per work-item, with two counters each */
/* Words per work-item in the scan of all counters. The extra one holds zeros: odd strides avoid bank conflicts. */
#define RAKE (COUNTERS + 1)
/* Index in local memory of the word of the tile's k-th element: a gap after every 32 avoids bank conflicts. */
#define PLACE(k) ((k) + (k) / 32U)
#define POOL PLACE(TILE)
#if RAKE * GROUP > POOL
#error "TILE is too small for GROUP"
#endif

/* Moves the k-th element of each work-item to index ranks[k] of the tile, then reads those at first, first + step, ...
 */
INLINE void exchange(ulong elements[VALUES], const uint ranks[VALUES], const uint first, const uint step,
                     local uint* pool) {
  uint2 words[VALUES];
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) pool[PLACE(ranks[k])] = (uint)elements[k];
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) words[k].x = pool[PLACE(first + k * step)];
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) pool[PLACE(ranks[k])] = (uint)(elements[k] >> 32);
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) words[k].y = pool[PLACE(first + k * step)];
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) elements[k] = (ulong)words[k].y << 32 | words[k].x;
}

/* The indices of the elements of this work-item in the tile's stable order by a digit of at most RANK_BITS bits, if
   work-items hold VALUES consecutive elements each. */
INLINE void rank_tile(const ulong elements[VALUES], uint ranks[VALUES], const uint first, const uint bits,
                      local uint* pool, local uint* scan_pool) {
  const uint item = (uint)get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (uint k = 0; k < RAKE; ++k) pool[k * GROUP + item] = 0;
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) {
    const uint digit = digit_of(elements[k], first, bits);
    local uint* counter = pool + digit % COUNTERS * GROUP + item;
    const uint half_word = digit / COUNTERS * 16U;
    const uint count = *counter;
    *counter = count + (1U << half_word);
    ranks[k] = count >> half_word & 0xffffU;
  }
  barrier(CLK_LOCAL_MEM_FENCE);

  uint sum = 0;
#pragma unroll
  for (uint k = 0; k < RAKE; ++k) sum += pool[item * RAKE + k];
  uint total;
  uint before = scan_group(sum, &total, scan_pool);
  before += total << 16; /* the digits of upper halves come after those of lower ones */
#pragma unroll
  for (uint k = 0; k < RAKE; ++k) {
    const uint count = pool[item * RAKE + k];
    pool[item * RAKE + k] = before;
    before += count;
  }
  barrier(CLK_LOCAL_MEM_FENCE);

#pragma unroll
  for (uint k = 0; k < VALUES; ++k) {
    const uint digit = digit_of(elements[k], first, bits);
    ranks[k] += pool[digit % COUNTERS * GROUP + item] >> (digit / COUNTERS * 16U) & 0xffffU;
  }
}

/* Sorts the tile by a range of bits. Work-items hold elements that are GROUP apart, before and after. */
INLINE void sort_tile(ulong elements[VALUES], const uint first, const uint bits, local uint* pool,
                      local uint* scan_pool) {
  const uint item = (uint)get_local_id(0);
  uint ranks[VALUES];
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) ranks[k] = k * GROUP + item;
  exchange(elements, ranks, item * VALUES, 1, pool);
  for (uint done = 0; done < bits; done += RANK_BITS) {
    const uint left = bits - done;
    rank_tile(elements, ranks, first + done, min(left, (uint)RANK_BITS), pool, scan_pool);
    const bool last = left <= RANK_BITS;
    exchange(elements, ranks, last ? item : item * VALUES, last ? GROUP : 1U, pool);
  }
}

#endif

#endif
