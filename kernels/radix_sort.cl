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

   A small number of elements is sorted by a whole range of bits in one or two launches: radix_sort_small sorts each
   tile, radix_sort_merge merges all tiles at once, by ranks (as Satish, Harris and Garland merge two).

   With GROUP 1 a single work-item processes a block, with private counters and neither local memory nor barriers. Then
   only the most significant digit is sorted by in this way. That splits the elements into buckets that fit into a
   processor's cache, each of which one work-item of radix_sort_buckets sorts by the remaining bits.

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

#if GROUP > 1

#ifndef TILE
#define TILE 4096 /* a multiple of GROUP, and a power of two less than 2^16 */
#endif
#if (TILE & (TILE - 1)) != 0
#error "binary searches of a tile halve their steps"
#endif
#define VALUES (TILE / GROUP) /* elements per work-item */
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

/* The elements of the tile, GROUP apart. Those from `end` on have all bits set, so they come after all others. */
static inline void load_tile(ulong elements[VALUES], global const ulong* restrict source, const uint tile,
                             const uint end) {
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) {
    const uint place = tile + k * GROUP + (uint)get_local_id(0);
    elements[k] = place < end ? source[place] : ~0UL;
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
          if (run != 0) atomic_add(&block_counts[run_digit], run);
          run_digit = digit;
          run = 0;
        }
        ++run;
      }
    }
    if (run != 0) atomic_add(&block_counts[run_digit], run);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint digit = item; digit < 1U << bits; digit += GROUP) {
    counts[digit * (uint)get_num_groups(0) + block] = block_counts[digit];
  }
}

#if DIGITS > GROUP
#error "a digit needs a work-item"
#endif
/* The indices at which the elements of each digit of a block begin. (No `restrict`: Oclgrind 21.10 does not know what
   remains of it after inlining.) */
INLINE void load_starts(local uint* starts, global const uint* counts, const bool is_scanned, const uint block,
                        const uint digits, local uint* scan_pool) {
  const uint digit = (uint)get_local_id(0);
  const uint blocks = (uint)get_num_groups(0);
  global const uint* own = counts + min(digit, digits - 1U) * blocks;
  uint all = 0;
  uint before = is_scanned ? own[block] : 0U;
  for (uint k = 0; k < blocks && !is_scanned; ++k) {
    const uint count = own[k];
    all += count;
    if (k < block) before += count;
  }
  uint total;
  before += scan_group(all, &total, scan_pool);
  if (digit < digits) starts[digit] = before;
  barrier(CLK_LOCAL_MEM_FENCE);
}

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void radix_sort_scatter(
    const uint n, const uint length, const uint first, const uint bits, global const ulong* restrict source,
    global ulong* restrict target, const uint is_scanned, global const uint* restrict counts) {
  local uint pool[POOL];
  local uint scan_pool[SCAN_POOL];
  local uint next[DIGITS]; /* the index of the next element of a digit */
  const uint item = (uint)get_local_id(0);
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  load_starts(next, counts, is_scanned != 0U, block, 1U << bits, scan_pool);
  for (uint tile = begin; tile < end; tile += TILE) {
    const uint size = min((uint)TILE, end - tile);
    ulong elements[VALUES];
    load_tile(elements, source, tile, end);
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
  }
}

/* Sorts each tile by a range of bits, one work-group per tile. If there is only one, both buffers may be the same. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void radix_sort_small(
    const uint n, const uint first, const uint bits, global ulong* source, global ulong* target) {
  local uint pool[POOL];
  local uint scan_pool[SCAN_POOL];
  const uint tile = (uint)get_group_id(0) * TILE;
  ulong own[VALUES];
  load_tile(own, source, tile, n);
  sort_tile(own, first, bits, pool, scan_pool);
#pragma unroll
  for (uint k = 0; k < VALUES; ++k) {
    const uint place = tile + k * GROUP + (uint)get_local_id(0);
    if (place < n) target[place] = own[k];
  }
}

#define SEARCHES 8U /* at the same time, per work-item: each of them mostly waits for memory */

/* The bits of an element, as a number. */
static inline ulong key_of(const ulong element, const uint first, const uint bits) {
  return element >> first & ~0UL >> (64U - bits);
}

/* Merges sorted tiles: the index of an element is the sum over all tiles of the elements there that come before it,
   which a work-item finds by binary search. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void radix_sort_merge(
    const uint n, const uint first, const uint bits, global const ulong* restrict source,
    global ulong* restrict target) {
  const uint own = (uint)get_global_id(0);
  if (own >= n) return;
  const ulong element = source[own];
  const ulong key = key_of(element, first, bits);
  uint before = own % TILE;
  for (uint tile = 0; tile * TILE < n; tile += SEARCHES) {
    uint counts[SEARCHES]; /* elements of each tile that come before */
#pragma unroll
    for (uint i = 0; i < SEARCHES; ++i) counts[i] = 0;
    for (uint step = TILE; step > 0; step /= 2U) {
      ulong keys[SEARCHES];
#pragma unroll
      for (uint i = 0; i < SEARCHES; ++i) {
        const uint last = (tile + i) * TILE + counts[i] + step - 1U;
        keys[i] = key_of(source[min(last, n - 1U)], first, bits);
      }
#pragma unroll
      for (uint i = 0; i < SEARCHES; ++i) {
        const uint last = (tile + i) * TILE + counts[i] + step - 1U;
        const uint end = tile + i == own / TILE ? 0U : min(n, (tile + i + 1U) * TILE);
        /* (Not by && or ||, because compilers then load one key after the other.) */
        const uint is_less = keys[i] < key ? 1U : 0U;
        const uint is_equal = keys[i] == key ? 1U : 0U;
        const uint is_earlier = tile + i < own / TILE ? 1U : 0U;
        const uint is_inside = last < end ? 1U : 0U;
        counts[i] += step * (is_inside & (is_less | (is_equal & is_earlier)));
      }
    }
#pragma unroll
    for (uint i = 0; i < SEARCHES; ++i) before += counts[i];
  }
  target[before] = element;
}

#else

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void radix_sort_count(
    const uint n, const uint length, const uint first, const uint bits, global const ulong* restrict elements,
    global uint* restrict counts) {
  uint block_counts[DIGITS];
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  for (uint digit = 0; digit < DIGITS; ++digit) block_counts[digit] = 0;
  for (uint k = begin; k < end; ++k) ++block_counts[digit_of(elements[k], first, bits)];
  for (uint digit = 0; digit < 1U << bits; ++digit) {
    counts[digit * (uint)get_num_groups(0) + block] = block_counts[digit];
  }
}

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void radix_sort_scatter(
    const uint n, const uint length, const uint first, const uint bits, global const ulong* restrict source,
    global ulong* restrict target, const uint is_scanned, global const uint* restrict starts) {
  (void)is_scanned;
  uint next[DIGITS]; /* the index of the next element of a digit */
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  for (uint digit = 0; digit < 1U << bits; ++digit) next[digit] = starts[digit * (uint)get_num_groups(0) + block];
  for (uint k = begin; k < end; ++k) {
    const ulong element = source[k];
    target[next[digit_of(element, first, bits)]++] = element;
  }
}

#define LONG_DIGIT_BITS 10 /* at most, for a pass of a work-item over at least LONG_RUN elements */
#define LONG_RUN 8192U

/* Sorts n elements of `source` by a range of bits, the least significant digit first, back and forth between two
   buffers. Returns the one that has them in the end. */
static inline global ulong* sort_run(const uint n, const uint first, const uint bits, global ulong* source,
                                     global ulong* target) {
  /* As few digits as possible, of about equal length. */
  const uint most_bits = n < LONG_RUN ? DIGIT_BITS : LONG_DIGIT_BITS;
  uint left = (bits + most_bits - 1U) / most_bits;
  for (uint done = 0; left > 0; --left) {
    const uint digit_first = first + done;
    const uint digit_bits = (bits - done + left - 1U) / left;
    const uint digits = 1U << digit_bits;
    uint next[1 << LONG_DIGIT_BITS]; /* the index of the next element of a digit */
    for (uint digit = 0; digit < digits; ++digit) next[digit] = 0;
    for (uint k = 0; k < n; ++k) ++next[digit_of(source[k], digit_first, digit_bits)];
    uint place = 0;
    for (uint digit = 0; digit < digits; ++digit) {
      const uint count = next[digit];
      next[digit] = place;
      place += count;
    }
    for (uint k = 0; k < n; ++k) {
      const ulong element = source[k];
      target[next[digit_of(element, digit_first, digit_bits)]++] = element;
    }
    global ulong* const sorted = target;
    target = source;
    source = sorted;
    done += digit_bits;
  }
  return source;
}

/* Sorts n elements by a range of bits, with one work-item. */
kernel __attribute__((reqd_work_group_size(1, 1, 1))) void radix_sort_small(
    const uint n, const uint first, const uint bits, global ulong* elements, global ulong* scratch) {
  global const ulong* sorted = sort_run(n, first, bits, elements, scratch);
  if (sorted == elements) return;
  for (uint k = 0; k < n; ++k) elements[k] = sorted[k];
}

/* Sorts each bucket by two ranges of bits, one work-item per bucket. Of the less significant range, .s0 is the first
   bit and .s1 the number of bits; of the other one, .s2 and .s3. The n elements are in `scratch` before, and in
   `elements` afterwards. Bucket k begins at starts[k * blocks]. */
kernel __attribute__((reqd_work_group_size(1, 1, 1))) void radix_sort_buckets(
    const uint n, const uint blocks, const uint4 ranges, global ulong* elements, global ulong* scratch,
    global const uint* restrict starts) {
  const uint bucket = (uint)get_group_id(0);
  const uint begin = starts[bucket * blocks];
  const uint end = bucket + 1U < (uint)get_num_groups(0) ? starts[(bucket + 1U) * blocks] : n;
  global ulong* const own = elements + begin;
  global ulong* source = scratch + begin;
  for (uint range = 0; range < 2U; ++range) {
    global ulong* const target = source == own ? scratch + begin : own;
    source =
        sort_run(end - begin, range == 0U ? ranges.s0 : ranges.s2, range == 0U ? ranges.s1 : ranges.s3, source, target);
  }
  if (source == own) return;
  for (uint k = 0; k < end - begin; ++k) own[k] = source[k];
}

#endif
