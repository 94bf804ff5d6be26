/* Brute force: tests every pair in which a box changed. Pairs that overlap and whose filters allow it are appended to a
   list, in no particular order, unless they were pairs in the last frame.

   A work-item holds WIDTH boxes `a` in registers and walks down rows, ROWS at a time, with one bit per box and row.
   Each row is a box `b`, the same for the whole work-group. Hits are collected in local memory, then tested by all
   work-items together; a work-group reserves its part of the list with one atomic. If local memory is too small for the
   hits of all its rows, it walks down fewer rows at a time.

   On a GPU, bounds are subtracted instead of compared: boxes overlap if none of six differences is negative.
   Subtractions and the merging of signs run on different units, which share the work; comparisons would all run on one
   of them. For this, bounds are made finite and zeros positive, so that differences have the right sign; hits are
   tested again with the original bounds. If the device takes denormal numbers for zeros, they are made zeros here:
   whether it also does so in other operations than arithmetic may differ from one to the next. */

#ifndef GROUP
#define GROUP 32 /* work-items per work-group; 1 with the tuning for CPUs: rows are not copied then */
#endif
#ifndef WIDTH
#define WIDTH 4 /* boxes of a work-item; 16 with the tuning for CPUs */
#endif
#define CALLERS_BOXES (GROUP > 1) /* with the tuning for GPUs, `boxes` may be the caller's */
#include "aabb.h"
#include "bits.h"
#include "delta.h"
#include "filter.h"
#include "gather.h"
#include "inline.h"
#include "keep.h"
#include "lanes.h"
#include "pair.h"

#ifndef MAX_ROWS
#define MAX_ROWS 128 /* rows of a work-group, at most */
#endif
#ifndef ROWS
#define ROWS 8 /* rows that a work-item tests before it looks for hits */
#endif
/* Capacity for hits; those of a single row fit. */
#define LOCAL_HITS 512U
#if GROUP * WIDTH > LOCAL_HITS
#error "LOCAL_HITS is too small"
#endif

/* A bit for each box of a work-item and each of ROWS rows, those of the first row lowest. */
#if ROWS * WIDTH == 64
typedef ulong hits_t;
#elif ROWS * WIDTH == 32
typedef uint hits_t;
#else
#error "ROWS * WIDTH must be 32 or 64"
#endif

#if GROUP > 1
#define NEXT(count) atomic_inc(count)
#else
#define NEXT(count) (*(count))++ /* an atomic takes a CPU longer */
#endif

typedef struct {
  FLOATS lower_x, lower_y, lower_z, upper_x, upper_y, upper_z;
} boxes_t;

/* A box. */
typedef struct {
  float4 lower, upper;
} row_t;

static inline row_t load_row(global const float* boxes, const uint slot) {
  box_t box;
  load_box(&box, boxes, slot);
  const row_t row = {(float4)(box.bound[0], box.bound[1], box.bound[2], 0.0F),
                     (float4)(box.bound[3], box.bound[4], box.bound[5], 0.0F)};
  return row;
}

#if GROUP > 1
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
#else
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
#endif

/* Whether a hit, of box `a` in row `b`, is a new pair. */
static inline bool is_new_pair(const uint a, const uint b, const bool all, global const float* boxes,
                               global const uint* changed_stamps, global const uint4* filters,
                               global const uint2* exclusions, const pair_sink_t* sink) {
  if (!all && a > b && is_changed(changed_stamps[a], sink->stamp)) return false; /* row `a` has it */
#if GROUP > 1
  if (!overlap(boxes, a, b)) return false;
#else
  (void)boxes;
#endif
  if (filters != 0 && !may_pair(filters[a], filters[b])) return false;
  const uint2 pair = pair_of(a, b);
  if (is_excluded(pair, exclusions)) return false;
  /* (A branch, because Oclgrind 21.10 evaluates some negated conditions as true.) */
  if (was_in_last_frame(sink, pair)) return false;
  return true;
}

/* Appends those hits that are new pairs. All work-items must call it. */
INLINE void append_new(local uint2* hits, const uint count, local uint* found_new, local uint* base, const bool all,
                       global const float* boxes, global const uint* changed_stamps, global const uint4* filters,
                       global const uint2* exclusions, const pair_sink_t* sink) {
  const uint item = (uint)get_local_id(0);
  for (uint first = 0; first < count; first += GROUP) {
    const uint2 hit = hits[min(first + item, count - 1U)];
    const bool is_new =
        first + item < count && is_new_pair(hit.x, hit.y, all, boxes, changed_stamps, filters, exclusions, sink);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (is_new) hits[NEXT(found_new)] = pair_of(hit.x, hit.y);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  append_pairs(sink, hits, *found_new, GROUP, base);
}

/* The slot of a row: every slot is a row, or those that changed are. */
static inline uint slot_of_row(const uint row, const bool all, global const uint* changed) {
  return all ? row : changed[row];
}

#if GROUP > 1
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
#else
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

/* Collects the hits of the rows from `first` on, as far as there is memory, and counts them. */
static inline void collect_hits(hits_t bits, const uint a, const uint first, const uint n, const bool all,
                                global const uint* changed, local uint2* hits, local uint* found) {
  for (; bits != 0; bits &= bits - 1U) {
    const uint bit = LOWEST_BIT(bits);
    const uint s_a = a + bit % WIDTH * GROUP;
    const uint b = slot_of_row(first + bit / WIDTH, all, changed);
    if (s_a >= n || s_a == b || (all && s_a > b)) continue;
    const uint k = NEXT(found);
    if (k < LOCAL_HITS) hits[k] = (uint2)(s_a, b);
  }
}

/* A work-item has WIDTH boxes `a`, by its index in dimension 0, and a run of rows, from the first on, by its index in
   dimension 1. Unless `last` is null, this also does the work of delta.cl; unless `copy` is null, `boxes` are the
   caller's, and this copies them. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void brute_force(
    const brute_force_scalars_t scalars, global const float* restrict boxes, global const uint* restrict changed,
    global const uint* restrict changed_stamps, global const uint4* restrict filters,
    global const uint2* restrict exclusions, global float* restrict copy, KEEP_PARAMETERS, PAIR_SINK_PARAMETERS) {
  const uint n = scalars.n;
  const uint rows = scalars.rows;
  const pair_sink_t sink = PAIR_SINK;
#if GROUP > 1
  local keep_t chunk;
  keep_pairs(&keep_scalars, last, removed, keep_filters, keep_exclusions, keep_stamps, boxes, pairs, counts,
             (uint)(get_group_id(1) * get_num_groups(0) + get_group_id(0)),
             (uint)(get_num_groups(0) * get_num_groups(1)), &chunk);
#endif
  local uint2 hits[LOCAL_HITS]; /* boxes `a` and `b`; those that are new pairs become pairs */
  local uint found;
  local uint found_new;
  local uint base;
  const uint item = (uint)get_local_id(0);
  if (item == 0U) found = found_new = 0;

  const bool all = scalars.row_count == n;
  const uint a = (uint)get_group_id(0) * (GROUP * WIDTH) + item;
  const uint first_row = (scalars.first_run + (uint)get_global_id(1)) * rows;
  const uint last_row = min(scalars.row_count, first_row + rows);
  const bool has_work = !is_halted(counts) && (!all || (uint)get_group_id(0) * (GROUP * WIDTH) < last_row);
  const uint end = has_work ? last_row : 0U;
#if GROUP > 1
  local row_t tile[MAX_ROWS + ROWS];
  load_tile(tile, first_row, rows, end, all, boxes, changed);
#endif
  for (uint k = 0; copy != 0 && get_group_id(1) == 0 && k < WIDTH && a + k * GROUP < n; ++k) {
    box_t box;
    gather_object(&box, a + k * GROUP, boxes, 0, AABB_FLOATS, n, 0, 0, 0, 0, copy, 0, counts);
  }
  barrier(CLK_LOCAL_MEM_FENCE);

  const uint begin = a >= n ? end : all ? max(first_row, a + 1U) : first_row;
  boxes_t s;
  if (begin < end) load_boxes(&s, boxes, a, n);

  uint step = rows;
  for (uint row = first_row; row < end;) {
    const uint stop = min(end, row + step);
    for (uint first = max(row, begin); first < stop; first += ROWS) {
#if GROUP > 1
      hits_t bits = test_rows(&s, tile + (first - first_row));
#else
      hits_t bits = test_rows(&s, first, end, all, boxes, changed);
#endif
      if (stop - first < ROWS) bits &= ((hits_t)1 << ((stop - first) * WIDTH)) - 1U;
      collect_hits(bits, a, first, n, all, changed, hits, &found);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint count = found;
    if (count > LOCAL_HITS) {
      step = max(1U, step * (LOCAL_HITS / 2U) / count);
    } else {
      append_new(hits, count, &found_new, &base, all, boxes, changed_stamps, filters, exclusions, &sink);
      row = stop;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0U) found = found_new = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
