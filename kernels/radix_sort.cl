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

   On a GPU, few elements take less time in fewer launches: radix_sort_small.cl.

   There are fewer than 2^31 elements, so that the sum of two indices fits into a uint. */

#include "radix_tile.h"

#ifndef DIGIT_BITS
#define DIGIT_BITS 8 /* at most, for a pass */
#endif
#define DIGITS (1 << DIGIT_BITS)

#if GROUP > 1
#define ADD(counter, count) atomic_add(counter, count)
#else
#define ADD(counter, count) (*(counter) += (count)) /* an atomic takes a CPU longer */
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
