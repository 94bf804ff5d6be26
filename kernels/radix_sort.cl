/* Stable ascending radix sort of 8-byte elements by ranges of their bits, the least significant digit first.

   A pass sorts by one digit of at most DIGIT_BITS bits. The elements are split into blocks of `length`, one per
   work-group:

     radix_sort_count     counts the digits of each block; counts are stored by digit, then by block
     (scan.cl)            their prefix sums are the indices at which each block's elements of each digit begin; if there
                          are few blocks, each work-group of radix_sort_scatter adds up the counts itself instead
     radix_sort_scatter   moves each element to its index

   as in Satish, Harris and Garland 2009, "Designing Efficient Sorting Algorithms for Manycore GPUs", with the fixed
   number of blocks of Merrill and Grimshaw 2011, "High Performance and Scalable Radix Sorting". No work-group waits for
   another.

   On a GPU, scatter first sorts each tile of TILE elements by the digit in local memory, so that elements which belong
   together are written together. It sorts by RANK_BITS bits at a time: each work-item counts its VALUES elements in
   private counters, whose prefix sums are ranks (as Merrill and Grimshaw do, with two counters per word).

   With GROUP 1 a single work-item processes a block, one element after the other.

   There are fewer than 2^31 elements, so that the sum of two indices fits into a uint. */

#ifndef __ENDIAN_LITTLE__
#error "two uints are sorted as one number, which takes a little-endian device"
#endif

#include "inline.h"
#include "scan.h"

#ifndef DIGIT_BITS
#define DIGIT_BITS 8 /* at most, for a pass */
#endif
#define DIGITS (1 << DIGIT_BITS)

static inline uint digit_of(const ulong element, const uint first, const uint bits) {
  return (uint)(element >> first) & ((1U << bits) - 1U);
}

#ifndef TILE
#define TILE (GROUP > 1 ? 4096 : 1) /* a multiple of GROUP, less than 2^16 */
#endif
#define VALUES (TILE / GROUP) /* elements per work-item */

#if GROUP > 1
#define ADD(counter, count) atomic_add(counter, count)
#else
#define ADD(counter, count) (*(counter) += (count)) /* an atomic takes a CPU longer */
#endif

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

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void radix_sort_count(
    const uint n, const uint length, const uint first, const uint bits, global const ulong* restrict elements,
    global uint* restrict counts) {
  local uint block_counts[DIGITS];
  const uint item = (uint)get_local_id(0);
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  for (uint digit = item; digit < DIGITS; digit += GROUP) block_counts[digit] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint tile = begin; tile < end; tile += TILE) {
    ulong own[VALUES];
    load_tile(own, elements, tile, end);
    /* Elements in a row with the same digit are added at once. */
    uint run_digit = 0;
    uint run = 0;
#pragma unroll
    for (uint k = 0; k < VALUES; ++k) {
      if (tile + k * GROUP + item < end) {
        const uint digit = digit_of(own[k], first, bits);
        if (digit != run_digit) {
          if (run != 0) ADD(&block_counts[run_digit], run);
          run_digit = digit;
          run = 0;
        }
        ++run;
      }
    }
    if (run != 0) ADD(&block_counts[run_digit], run);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint digit = item; digit < 1U << bits; digit += GROUP) {
    counts[digit * (uint)get_num_groups(0) + block] = block_counts[digit];
  }
}

/* The indices at which the elements of each digit of a block begin. (No `restrict`: Oclgrind 21.10 does not know what
   remains of it after inlining.) */
INLINE void load_starts(local uint* starts, global const uint* counts, const bool is_scanned, const uint block,
                        const uint digits, local uint* scan_pool) {
  const uint blocks = (uint)get_num_groups(0);
  uint start = 0; /* of the digits of this step */
  for (uint step = 0; step < digits; step += GROUP) {
    const uint digit = step + (uint)get_local_id(0);
    global const uint* own = counts + min(digit, digits - 1U) * blocks;
    uint all = 0;
    uint before = is_scanned ? own[block] : 0U;
    for (uint k = 0; k < blocks && !is_scanned; ++k) {
      const uint count = own[k];
      all += count;
      if (k < block) before += count;
    }
    uint total;
    before += start + scan_group(all, &total, scan_pool);
    start += total;
    if (digit < digits) starts[digit] = before;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void radix_sort_scatter(
    const uint n, const uint length, const uint first, const uint bits, global const ulong* restrict source,
    global ulong* restrict target, const uint is_scanned, global const uint* restrict counts) {
#if GROUP > 1
  local uint pool[POOL];
#endif
  local uint scan_pool[SCAN_POOL];
  local uint next[DIGITS]; /* the index of the next element of a digit */
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  load_starts(next, counts, is_scanned != 0U, block, 1U << bits, scan_pool);
  for (uint tile = begin; tile < end; tile += TILE) {
    ulong elements[VALUES];
    load_tile(elements, source, tile, end);
#if GROUP == 1
    target[next[digit_of(elements[0], first, bits)]++] = elements[0];
#else
    const uint item = (uint)get_local_id(0);
    const uint size = min((uint)TILE, end - tile);
    sort_tile(elements, first, bits, pool, scan_pool);

    barrier(CLK_LOCAL_MEM_FENCE);
    local uint* digits = pool;
#pragma unroll
    for (uint k = 0; k < VALUES; ++k) digits[k * GROUP + item] = digit_of(elements[k], first, bits);
    barrier(CLK_LOCAL_MEM_FENCE);
    /* Temporarily, the position in the tile at which the digit begins is subtracted from `next`. */
#pragma unroll
    for (uint k = 0; k < VALUES; ++k) {
      const uint position = k * GROUP + item;
      const uint digit = digit_of(elements[k], first, bits);
      if (position < size && (position == 0 || digits[position - 1U] != digit)) next[digit] -= position;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
    for (uint k = 0; k < VALUES; ++k) {
      const uint position = k * GROUP + item;
      if (position < size) target[next[digit_of(elements[k], first, bits)] + position] = elements[k];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
    for (uint k = 0; k < VALUES; ++k) {
      const uint position = k * GROUP + item;
      const uint digit = digit_of(elements[k], first, bits);
      if (position < size && (position == size - 1U || digits[position + 1U] != digit)) next[digit] += position + 1U;
    }
#endif
  }
}
