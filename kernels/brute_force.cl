/* Brute force: tests every pair in which a box changed. Pairs that overlap and whose filters allow it are appended to a
   list, in no particular order, unless they were pairs in the last frame.

   A work-item holds WIDTH boxes `a` in registers and walks down rows. Each row is a box `b`, the same for the whole
   work-group. Hits are collected in local memory, then tested by all work-items together; a work-group reserves its
   part of the list with one atomic. If local memory is too small for the hits of all its rows, it walks down fewer rows
   at a time.

   On a GPU, bounds are subtracted instead of compared: boxes overlap if none of six differences is negative.
   Subtractions and the merging of signs run on different units, which share the work; comparisons would all run on one
   of them. For this, bounds are made finite and zeros positive, so that differences have the right sign; hits are
   tested again with the original bounds. If the device takes denormal numbers for zeros, they are made zeros here:
   whether it also does so in other operations than arithmetic may differ from one to the next. */

#ifndef GROUP
#define GROUP 32 /* work-items per work-group; 1 with the tuning profile for CPUs: rows are not copied then */
#endif
#include "aabb.h"
#include "delta.h"
#include "filter.h"
#include "inline.h"
#include "keep.h"
#include "lanes.h"

#ifndef MAX_ROWS
#define MAX_ROWS 128 /* rows of a work-group, at most */
#endif
#ifndef ROWS
#define ROWS 4 /* rows that a work-item tests before it looks for hits */
#endif
#ifndef WORLDS
#define WORLDS 0 /* 1 if objects are in different worlds */
#endif
/* Room for hits; those of a single row fit. */
#define LOCAL_HITS 512U
#if GROUP * WIDTH > LOCAL_HITS
#error "LOCAL_HITS is too small"
#endif

#if GROUP > 1
#define NEXT(count) atomic_inc(count)
#else
#define NEXT(count) (*(count))++ /* an atomic takes a CPU longer */
#endif

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
  const uint2 pair = (uint2)(min(a, b), max(a, b));
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
    if (is_new) hits[NEXT(found_new)] = (uint2)(min(hit.x, hit.y), max(hit.x, hit.y));
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  append_pairs(sink, hits, *found_new, GROUP, base);
}

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
  local keep_t chunk;
  if (keeps != 0U) {
    keep_pairs(last, last_capacity, removed, keep_filters, keep_exclusions, keep_all, keep_stamps, n, boxes, stamp,
               capacity, pairs, counts, (uint)(get_group_id(1) * get_num_groups(0) + get_group_id(0)),
               (uint)(get_num_groups(0) * get_num_groups(1)), &chunk);
  }
#endif
  local uint2 hits[LOCAL_HITS]; /* boxes `a` and `b`; those that are new pairs become pairs */
  local uint found;
  local uint found_new;
  local uint base;
  const uint item = (uint)get_local_id(0);
  if (item == 0U) found = found_new = 0;

  const bool all = row_count == n;
  const uint a = (uint)get_global_id(0) * WIDTH;
  const uint first_row = (first_run + (uint)get_global_id(1)) * rows;
  const uint last_row = min(row_count, first_row + rows);
  const bool has_work = !is_halted(counts) && (!all || (uint)get_group_id(0) * (GROUP * WIDTH) < last_row);
  const uint end = has_work ? last_row : 0U;
#if GROUP > 1
  local row_t tile[MAX_ROWS + ROWS];
  for (uint k = item; first_row < end && k < rows + ROWS; k += GROUP) {
    const uint row = min(first_row + k, end - 1U);
    tile[k] = finite_row(load_row(boxes, filters, all ? row : changed[row]));
  }
#define ROW(first, r) (tile + ((first)-first_row))[r]
#else
#define ROW(first, r) \
  load_row(boxes, filters, all ? min((first) + (r), end - 1U) : changed[min((first) + (r), end - 1U)])
#endif
  barrier(CLK_LOCAL_MEM_FENCE);

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

  uint step = rows;
  for (uint row = first_row; row < end;) {
    const uint stop = min(end, row + step);
    for (uint first = max(row, begin); first < stop; first += ROWS) {
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
      for (uint r = 0; r < min((uint)ROWS, stop - first); ++r) {
        if (!any(may[r])) continue;
        uint bits = lane_mask(LANES(may[r], &s, ROW(first, r)));
        const uint b = all ? first + r : changed[first + r];
        for (uint s_a = a; bits != 0; ++s_a, bits >>= 1) {
          if ((bits & 1U) == 0 || s_a >= n || s_a == b || (all && s_a > b)) continue;
          const uint k = NEXT(&found);
          if (k < LOCAL_HITS) hits[k] = (uint2)(s_a, b);
        }
      }
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
