/* Where worlds begin in lists of pairs, and a stable sort by world. */

#include "order.h"

/* Finds where each world begins in lists that are sorted by world, one work-item per world; after the worlds come the
   pairs of no such world and the end. The lengths are those of `report`. */
kernel void order_offsets(const uint worlds, const uint second_set, global const uint* restrict report,
                          global const uint2* restrict added, global const uint2* restrict removed,
                          global const uint4* restrict filters, global const uint4* restrict last_filters,
                          global uint* restrict added_offsets, global uint* restrict removed_offsets) {
  const uint world = (uint)get_global_id(0);
  if (world > worlds + 1U) return;
  for (uint list = 0; list < 2U; ++list) {
    const bool is_added = list == 0U;
    uint begin = 0;
    uint end = report[list];
    while (begin < end) {
      const uint middle = begin + (end - begin) / 2U;
      uint2 pair = is_added ? added[middle] : removed[middle];
      pair.y += second_set;
      if (world_of(pair, worlds, is_added ? filters : last_filters) < world) {
        begin = middle + 1U;
      } else {
        end = middle;
      }
    }
    (is_added ? added_offsets : removed_offsets)[world] = begin;
  }
}

/* For a stable sort by world: elements are indices of a list, and the worlds of its pairs. */
kernel void order_world_keys(const uint n, const uint worlds, global const uint2* restrict list,
                             global const uint4* restrict filters, global uint2* restrict elements) {
  const uint k = (uint)get_global_id(0);
  if (k < n) elements[k] = (uint2)(k, world_of(list[k], worlds, filters));
}

/* Moves the pairs of a list to the order of such elements. */
kernel void order_pick(const uint n, global const uint2* restrict elements, global const uint2* restrict list,
                       global uint2* restrict to) {
  const uint k = (uint)get_global_id(0);
  if (k < n) to[k] = list[elements[k].x];
}
