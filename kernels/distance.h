/* How far boxes are apart: base/distance.hpp. Objects reach beyond their boxes, so what is searched are boxes that are
   grown by the reaches. Each slot also has a float8 with the box as it was, its reach, and a number without a meaning.
 */
#ifndef BROADCL_DISTANCE_H
#define BROADCL_DISTANCE_H

#include "aabb.h"

#define REACH 6U /* its place in a float8 */
#define LEAST_DISTANCE 0x1p-63F

/* Whether two objects whose grown boxes overlap are within the sum of their reaches; also if no object has a reach,
   and `ungrown` is null. (Right also if denormal numbers count as zeros.) */
static inline bool are_within_reach(global const float8* ungrown, const uint2 pair) {
#pragma OPENCL FP_CONTRACT OFF
  if (ungrown == 0) return true;
  global const float* s = (global const float*)(ungrown + pair.x);
  global const float* t = (global const float*)(ungrown + pair.y);
  int overlap = 1;
  float square = 0;
#pragma unroll 1 /* more would take registers that kernels need without reaches */
  for (uint i = 0; i < 3U; ++i) {
    const float lower_s = s[i];
    const float upper_s = s[i + 3U];
    const float lower_t = t[i];
    const float upper_t = t[i + 3U];
    overlap &= NOT_ABOVE(lower_s, upper_t) & NOT_ABOVE(lower_t, upper_s);
    const float gap = upper_s < lower_t ? lower_t - upper_s : upper_t < lower_s ? lower_s - upper_t : 0.0F;
    square += gap < LEAST_DISTANCE ? 0.0F : gap * gap;
  }
  const float distance = s[REACH] + t[REACH];
  return distance < LEAST_DISTANCE ? overlap != 0 : square <= distance * distance;
}

/* Copies the box of a slot to `ungrown`, with its reach, and grows it, by so much more that boxes overlap if the
   reaches do, however distances are rounded. (Bounds need no more: of two sums, the larger one is not rounded to less.)
 */
static inline void grow(global float* boxes, global float8* ungrown, const uint slot, const float reach) {
  box_t box;
  load_box(&box, boxes, slot);
  ungrown[slot] =
      (float8)(box.bound[0], box.bound[1], box.bound[2], box.bound[3], box.bound[4], box.bound[5], reach, 0.0F);
  if (!(reach > 0) || isnan(box.bound[0])) return;
  const float margin = fmax(reach * (1.0F + 0x1p-20F), LEAST_DISTANCE);
  global float* p = boxes + (size_t)slot * AABB_FLOATS;
  for (uint i = 0; i < 3U; ++i) {
    p[i] = box.bound[i] - margin;
    p[i + 3U] = box.bound[i + 3U] + margin;
  }
}

#endif
