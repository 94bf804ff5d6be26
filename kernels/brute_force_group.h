/* Rows of brute force on a GPU: a work-group copies them to local memory.

   Bounds are subtracted instead of compared: boxes overlap if none of six differences is negative. Subtractions and the
   merging of signs run on different units, which share the work; comparisons would all run on one of them. For this,
   bounds are made finite and zeros positive, so that differences have the right sign; hits are tested again with the
   original bounds. If the device takes denormal numbers for zeros, they are made zeros here: whether it also does so in
   other operations than arithmetic may differ from one to the next. */
#ifndef BROADCL_BRUTE_FORCE_GROUP_H
#define BROADCL_BRUTE_FORCE_GROUP_H

/* Bits of a float, of which at least one is set if it is not zero (and not denormal, if the device takes these for
   zeros). */
#define NOT_ZERO (FLUSHES ? 0x7f800000 : 0x7fffffff)

/* Bounds without infinities and negative zeros; boxes that overlap still overlap. (Zeros are changed by their bits,
   since compilers remove the addition of 0.) */
static inline float finite(const float bound) {
  const float f = fmin(fmax(bound, -FLT_MAX), FLT_MAX);
  return (as_int(f) & NOT_ZERO) == 0 ? 0.0F : f;
}
static inline FLOATS finite_lanes(const FLOATS bounds) {
  const INTS bits = AS_INTS(fmin(fmax(bounds, -FLT_MAX), FLT_MAX));
  return AS_FLOATS(select(bits, (INTS)(0), (bits & (INTS)(NOT_ZERO)) == (INTS)(0)));
}

static inline row_t finite_row(const row_t row) {
  const bool empty = isnan(row.lower.x) != 0;
  row_t result = row;
  result.lower.x = empty ? FLT_MAX : finite(row.lower.x);
  result.lower.y = finite(row.lower.y);
  result.lower.z = finite(row.lower.z);
  result.upper.x = empty ? -FLT_MAX : finite(row.upper.x);
  result.upper.y = finite(row.upper.y);
  result.upper.z = finite(row.upper.z);
  return result;
}

#if WIDTH != 4
#error "WIDTH must be 4"
#endif

/* Box k of a work-item is in slot a + k * GROUP, so that work-items with successive indices read successive boxes. */
static inline void load_boxes(boxes_t* s, global const float* boxes, const uint a, const uint n) {
  box_t four[WIDTH];
  for (uint k = 0; k < WIDTH; ++k) load_box(&four[k], boxes, min(a + k * GROUP, n - 1U));
#define LANES(i) finite_lanes((FLOATS)(four[0].bound[i], four[1].bound[i], four[2].bound[i], four[3].bound[i]))
  s->lower_x = LANES(0);
  s->lower_y = LANES(1);
  s->lower_z = LANES(2);
  s->upper_x = LANES(3);
  s->upper_y = LANES(4);
  s->upper_z = LANES(5);
}

/* Negative if the boxes of a lane are apart. */
static inline INTS apart(const boxes_t* s, const row_t t) {
  return (AS_INTS(t.upper.x - s->lower_x) | AS_INTS(t.upper.y - s->lower_y) | AS_INTS(t.upper.z - s->lower_z)) |
         (AS_INTS(s->upper_x - t.lower.x) | AS_INTS(s->upper_y - t.lower.y) | AS_INTS(s->upper_z - t.lower.z));
}

/* Appends the signs of four lanes below the bits, in an order that gives the first lane the lowest bit. */
static inline hits_t append_signs(const hits_t bits, const INTS lanes) {
  const uint4 sign = as_uint4(lanes) >> 31;
  return (((bits << 1 | sign.w) << 1 | sign.z) << 1 | sign.y) << 1 | sign.x;
}

static inline bool overlap(global const float* boxes, const uint a, const uint b) {
  box_t s;
  box_t t;
  load_box(&s, boxes, a);
  load_box(&t, boxes, b);
  return boxes_overlap(&s, &t);
}

/* Loads the rows of a work-group, and the last one again for those that are missing. */
static inline void load_tile(local row_t* tile, const uint first_row, const uint rows, const uint end, const bool all,
                             global const float* boxes, global const uint* changed) {
  for (uint k = (uint)get_local_id(0); first_row < end && k < rows + ROWS; k += GROUP) {
    const uint slot = slot_of_row(min(first_row + k, end - 1U), all, changed);
    tile[k] = finite_row(load_row(boxes, slot));
  }
}

/* Tests ROWS rows against the boxes of a work-item: hits, of which some may be none with the original bounds. */
static inline hits_t test_rows(const boxes_t* s, local const row_t* rows) {
  hits_t bits = 0;
#pragma unroll 4 /* more would take too many registers */
  for (uint r = ROWS; r-- > 0U;) {
    bits = append_signs(bits, apart(s, rows[r]));
  }
  return ~bits;
}

#endif
