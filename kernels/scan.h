/* The exclusive prefix sum of one value per work-item over a work-group. */
#ifndef BROADCL_SCAN_H
#define BROADCL_SCAN_H
#include "inline.h"

#ifndef GROUP
#define GROUP 256 /* work-items per work-group; with 1 there is no barrier */
#endif
#define SCAN_POOL (2 * GROUP) /* uints of local memory that it takes */

/* Returns the sum (modulo 2^32) of the values of the work-items before this one; `total` becomes that of all. Every
   work-item of the group must call it. In log2(GROUP) steps: Hillis and Steele 1986, "Data Parallel Algorithms". */
INLINE uint scan_group(const uint value, uint* total, local uint* scan_pool) {
#if GROUP == 1
  (void)scan_pool;
  *total = value;
  return 0;
#else
  const uint item = (uint)get_local_id(0);
  local uint* now = scan_pool;
  local uint* next = scan_pool + GROUP;
  now[item] = value;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint distance = 1; distance < GROUP; distance *= 2) {
    next[item] = now[item] + (item >= distance ? now[item - distance] : 0U);
    barrier(CLK_LOCAL_MEM_FENCE);
    local uint* const done = now;
    now = next;
    next = done;
  }
  *total = now[GROUP - 1];
  const uint before = now[item] - value;
  barrier(CLK_LOCAL_MEM_FENCE);
  return before;
#endif
}

#endif
