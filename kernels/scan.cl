/* Exclusive prefix sum of uints, in place or not, modulo 2^32: reduce, then scan.

   The values are split into blocks of `length`, one per work-group. scan_sums adds up each block; scan_blocks turns
   each block into its prefix sums, which start with the sum of the blocks before it: two launches for any number of
   values, and no work-group waits for another. If one block is enough, scan_blocks alone does it. (Blelloch 1990,
   "Prefix Sums and Their Applications", on vectors longer than the number of processors.)

   A work-group goes through its block in tiles of four values per work-item, so that each reads and writes one aligned
   uint4. There are fewer than 2^31 values, so that the sum of two indices fits into a uint. */

#include "scan.h"

#define SCAN_TILE (4U * GROUP)

/* The values first .. first + 3, those from `end` on as 0. */
static inline uint4 load_values(global const uint* values, const uint first, const uint end) {
  if (first + 4U <= end) return *(global const uint4*)(values + first);
  uint4 four = 0;
  if (first < end) four.x = values[first];
  if (first + 1U < end) four.y = values[first + 1U];
  if (first + 2U < end) four.z = values[first + 2U];
  return four;
}

static inline void store_values(const uint4 four, global uint* values, const uint first, const uint end) {
  if (first + 4U <= end) {
    *(global uint4*)(values + first) = four;
    return;
  }
  if (first < end) values[first] = four.x;
  if (first + 1U < end) values[first + 1U] = four.y;
  if (first + 2U < end) values[first + 2U] = four.z;
}

/* The sum of each block. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void scan_sums(
    const uint n, const uint length, global const uint* restrict values, global uint* restrict sums) {
  local uint scan_pool[SCAN_POOL];
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  uint4 four = 0;
  for (uint first = begin + 4U * (uint)get_local_id(0); first < end; first += SCAN_TILE) {
    four += load_values(values, first, end);
  }
  uint total;
  (void)scan_group(four.x + four.y + four.z + four.w, &total, scan_pool);
  if (get_local_id(0) == 0) sums[block] = total;
}

/* Computes the prefix sums of each block. `sums` are those of the blocks; that of the last one is not read. `to` may be
   `values`. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void scan_blocks(
    const uint n, const uint length, global const uint* values, global const uint* restrict sums, global uint* to) {
  local uint scan_pool[SCAN_POOL];
  const uint item = (uint)get_local_id(0);
  const uint block = (uint)get_group_id(0);
  const uint begin = block * length;
  const uint end = min(n, begin + length);
  uint part = 0; /* of what comes before */
  for (uint k = item; k < block; k += GROUP) part += sums[k];
  uint start;
  (void)scan_group(part, &start, scan_pool);
  for (uint tile = begin; tile < end; tile += SCAN_TILE) {
    const uint first = tile + 4U * item;
    const uint4 four = load_values(values, first, end);
    uint total;
    const uint x = start + scan_group(four.x + four.y + four.z + four.w, &total, scan_pool);
    const uint y = x + four.x;
    const uint z = y + four.y;
    store_values((uint4)(x, y, z, z + four.z), to, first, end);
    start += total;
  }
}
