/* Rows of brute force with the tuning for CPUs: a work-item reads each where it is. */
#ifndef BROADCL_BRUTE_FORCE_ITEM_H
#define BROADCL_BRUTE_FORCE_ITEM_H

static inline void load_boxes(boxes_t* s, global const float* boxes, const uint a, const uint n) {
  global const float* p = boxes + (size_t)a * AABB_FLOATS;
  s->lower_x = BOUNDS(p);
  s->lower_y = BOUNDS(p + 1);
  s->lower_z = BOUNDS(p + 2);
  s->upper_x = BOUNDS(p + 3);
  s->upper_y = BOUNDS(p + 4);
  s->upper_z = BOUNDS(p + 5);
  (void)n;
}

/* Lanes are -1 if the boxes overlap. */
static inline INTS test_boxes(const boxes_t* s, const row_t t) {
  return AABB_OVERLAPS_LANES(s->lower_x, s->lower_y, s->lower_z, s->upper_x, s->upper_y, s->upper_z, t.lower.x,
                             t.lower.y, t.lower.z, t.upper.x, t.upper.y, t.upper.z);
}

/* Tests ROWS rows against the boxes of a work-item. */
static inline hits_t test_rows(const boxes_t* s, const uint first, const uint end, const bool all,
                               global const float* boxes, global const uint* changed) {
  INTS hit[ROWS];
  INTS some = 0;
  for (uint r = 0; r < ROWS; ++r) {
    hit[r] = test_boxes(s, load_row(boxes, slot_of_row(min(first + r, end - 1U), all, changed)));
    some |= hit[r];
  }
  hits_t bits = 0;
  if (!any(some)) return bits;
  for (uint r = 0; r < ROWS; ++r) bits |= (hits_t)lane_mask(hit[r]) << (r * WIDTH);
  return bits;
}

#endif
