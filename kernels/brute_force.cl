/* Brute force: tests every pair in which a box changed. Pairs that overlap and whose filters allow it are appended to a
   list, in no particular order, unless they were pairs in the last frame.

   A work-item holds WIDTH boxes `a` in registers and walks down rows. Each row is a box `b`, the same for the whole
   work-group. Hits are collected in local memory; a work-group reserves its part of the list with one atomic. If local
   memory was too small, the work-group walks again and writes to its part directly.

   On a GPU, bounds are subtracted instead of compared: boxes overlap if none of six differences is negative.
   Subtractions and the merging of signs run on different units, which share the work; comparisons would all run on one
   of them. For this, bounds are made finite and zeros positive, so that differences have the right sign; hits are
   tested again with the original bounds. */

#include "aabb.h"
#include "delta.h"
#include "filter.h"
#include "keep.h"
#include "lanes.h"

#ifndef GROUP
#define GROUP 64 /* work-items per work-group; 1 with the tuning profile for CPUs: rows are not copied then */
#endif
#ifndef MAX_ROWS
#define MAX_ROWS 128 /* rows of a work-group, at most */
#endif
#ifndef ROWS
#define ROWS 4 /* rows that a work-item tests before it looks for hits */
#endif
#ifndef WORLDS
#define WORLDS 0 /* 1 if objects are in different worlds */
#endif
#define LOCAL_HITS 512U

typedef struct {
  FLOATS lower_x, lower_y, lower_z, upper_x, upper_y, upper_z;
#if WORLDS
  INTS world;
#endif
} boxes_t;

/* A box; lower.w holds the bits of its world. */
typedef struct {
  float4 lower, upper;
} row_t;

static inline row_t load_row(global const float* boxes, global const uint4* filters, const uint slot) {
  global const float2* p = (global const float2*)(boxes + (size_t)slot * AABB_FLOATS);
  const float2 p0 = p[0];
  const float2 p1 = p[1];
  const float2 p2 = p[2];
  const row_t row = {
      (float4)(p0.x, p0.y, p1.x, WORLDS ? as_float(filters[slot].w) : 0.0F), (float4)(p1.y, p2.x, p2.y, 0.0F)};
  return row;
}

/* Lanes are -1 if the boxes overlap. */
static inline INTS test_boxes(const boxes_t* s, const row_t t) {
  return AABB_OVERLAPS_LANES(s->lower_x, s->lower_y, s->lower_z, s->upper_x, s->upper_y, s->upper_z, t.lower.x,
                             t.lower.y, t.lower.z, t.upper.x, t.upper.y, t.upper.z);
}

#if GROUP > 1
/* Bounds without infinities and negative zeros; boxes that overlap still overlap. (Zeros are changed by their bits,
   since compilers remove the addition of 0.) */
static inline float finite(const float bound) {
  const float f = fmin(fmax(bound, -FLT_MAX), FLT_MAX);
  return as_uint(f) == 0x80000000U ? 0.0F : f;
}
static inline FLOATS finite_lanes(const FLOATS bounds) {
  const INTS bits = AS_INTS(fmin(fmax(bounds, -FLT_MAX), FLT_MAX));
  return AS_FLOATS(select(bits, (INTS)(0), bits == (INTS)(INT_MIN)));
}
#define FINITE(bounds) finite_lanes(bounds)

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

/* Negative if a lane may overlap. */
typedef int may_t;
static inline may_t may_overlap(const boxes_t* s, const row_t t) {
  const INTS apart =
      (AS_INTS(t.upper.x - s->lower_x) | AS_INTS(t.upper.y - s->lower_y) | AS_INTS(t.upper.z - s->lower_z)) |
      (AS_INTS(s->upper_x - t.lower.x) | AS_INTS(s->upper_y - t.lower.y) | AS_INTS(s->upper_z - t.lower.z));
  return ~and_lanes(apart);
}

/* Lanes: whether the finite bounds overlap, which more boxes may do. */
#define LANES(may, s, t) test_boxes(s, t)

static inline bool overlap(global const float* boxes, const uint a, const uint b) {
  box_t s;
  box_t t;
  load_box(&s, boxes, a);
  load_box(&t, boxes, b);
  return boxes_overlap(&s, &t);
}
#else
#define FINITE(bounds) (bounds)

typedef INTS may_t;
#define may_overlap test_boxes
#define LANES(may, s, t) (may)
#endif

/* A work-item has WIDTH boxes `a`, by its index in dimension 0, and a run of `rows` rows, from `first_run` on, by its
   index in dimension 1. If row_count is n, every slot is a row and pairs are tested with a < b; otherwise the rows are
   the slots that changed. `keeps` says whether to do the work of delta.cl as well. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void brute_force(
    const uint n, const uint row_count, const uint rows, const uint first_run, global const float* restrict boxes,
    global const uint* restrict changed, global const uint* restrict changed_stamps,
    global const uint4* restrict filters, global const uint2* restrict exclusions, const uint keeps, KEEP_PARAMETERS,
    PAIR_SINK_PARAMETERS) {
  const pair_sink_t sink = PAIR_SINK;
#if GROUP > 1
  local uint keep_scratch[4];
  if (keeps != 0U) {
    keep_pairs(last, last_capacity, removed, keep_filters, keep_exclusions, keep_all, keep_stamps, n, boxes, stamp,
               capacity, pairs, counts, (uint)(get_group_id(1) * get_num_groups(0) + get_group_id(0)),
               (uint)(get_num_groups(0) * get_num_groups(1)), GROUP, keep_scratch);
  }
#endif
  local uint2 hits[LOCAL_HITS];
  local uint found;
  local uint base;
  if (get_local_id(0) == 0) found = 0;

  const bool all = row_count == n;
  const uint first_row = (first_run + (uint)get_global_id(1)) * rows;
  const uint end = is_halted(counts) ? 0U : min(row_count, first_row + rows);
#if GROUP > 1
  local row_t tile[MAX_ROWS + ROWS];
  const bool has_work = first_row < end && (!all || (uint)get_group_id(0) * (GROUP * WIDTH) < end);
  for (uint k = (uint)get_local_id(0); has_work && k < rows + ROWS; k += GROUP) {
    const uint row = min(first_row + k, end - 1U);
    tile[k] = finite_row(load_row(boxes, filters, all ? row : changed[row]));
  }
#define ROW(first, r) (tile + ((first)-first_row))[r]
#else
#define ROW(first, r) \
  load_row(boxes, filters, all ? min((first) + (r), end - 1U) : changed[min((first) + (r), end - 1U)])
#endif
  barrier(CLK_LOCAL_MEM_FENCE);

  const uint a = (uint)get_global_id(0) * WIDTH;
  const uint begin = a >= n ? end : all ? max(first_row, a + 1U) : first_row;
  boxes_t s;
  if (begin < end) {
    global const float* p = boxes + (size_t)a * AABB_FLOATS;
    s.lower_x = FINITE(BOUNDS(p));
    s.lower_y = FINITE(BOUNDS(p + 1));
    s.lower_z = FINITE(BOUNDS(p + 2));
    s.upper_x = FINITE(BOUNDS(p + 3));
    s.upper_y = FINITE(BOUNDS(p + 4));
    s.upper_z = FINITE(BOUNDS(p + 5));
#if WORLDS
    s.world = WORLD_OF(filters + a);
#endif
  }

  for (uint pass = 0; pass < 2U; ++pass) {
    for (uint first = begin; first < end; first += ROWS) {
      may_t may[ROWS];
      may_t some = 0;
      for (uint r = 0; r < ROWS; ++r) {
        const row_t t = ROW(first, r);
#if WORLDS
        const bool meet =
            any((s.world == as_int(t.lower.w)) | (s.world == (int)ALL_WORLDS)) || as_uint(t.lower.w) == ALL_WORLDS;
        may[r] = meet ? may_overlap(&s, t) : (may_t)(0);
#else
        may[r] = may_overlap(&s, t);
#endif
        some |= may[r];
      }
      if (!any(some)) continue;
      for (uint r = 0; r < min((uint)ROWS, end - first); ++r) {
        if (!any(may[r])) continue;
        uint bits = lane_mask(LANES(may[r], &s, ROW(first, r)));
        const uint b = all ? first + r : changed[first + r];
        for (uint s_a = a; bits != 0; ++s_a, bits >>= 1) {
          if ((bits & 1U) == 0) continue;
          if (s_a >= n || s_a == b || (s_a > b && (all || is_changed(changed_stamps[s_a], stamp)))) continue;
#if GROUP > 1
          if (!overlap(boxes, s_a, b)) continue;
#endif
          if (filters != 0 && !may_pair(filters[s_a], filters[b])) continue;
          const uint2 pair = (uint2)(min(s_a, b), max(s_a, b));
          if (is_excluded(pair, exclusions)) continue;
          if (was_in_last_frame(&sink, pair)) continue;
          const uint k = atomic_inc(&found);
          if (pass == 1U) {
            append_pair(&sink, base, k, pair);
          } else if (k < LOCAL_HITS) {
            hits[k] = pair;
          }
        }
      }
    }
    if (pass == 1U) break;

    barrier(CLK_LOCAL_MEM_FENCE);
    const uint total = found;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0) {
      base = total == 0 ? 0U : reserve_pairs(&sink, total);
      found = 0;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (total > LOCAL_HITS) continue;
    for (uint k = (uint)get_local_id(0); k < total; k += GROUP) append_pair(&sink, base, k, hits[k]);
    break;
  }
}
