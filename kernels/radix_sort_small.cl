/* Sorts few elements by a range of bits, on a GPU, in one or two launches: each tile, and then all tiles are merged at
   once, by ranks (as Satish, Harris and Garland merge two; see radix_sort.cl). */

#include "radix_tile.h"

#if GROUP > 1

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

#endif
