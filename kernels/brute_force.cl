/* Brute force: tests every pair in which a box changed. Pairs that overlap and whose filters allow it are appended to a
   list, in no particular order, unless they were pairs in the last frame.

   A work-item holds WIDTH boxes `a` in registers and walks down rows, ROWS at a time, with one bit per box and row.
   Each row is a box `b`, the same for the whole work-group. Hits are collected in local memory, then tested by all
   work-items together; a work-group reserves its part of the list with one atomic. If local memory is too small for the
   hits of all its rows, it walks down fewer rows at a time. */

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

/* The slot of a row: every slot is a row, or those that changed are. */
static inline uint slot_of_row(const uint row, const bool all, global const uint* changed) {
  return all ? row : changed[row];
}

#if GROUP > 1
#include "brute_force_group.h"
#else
#include "brute_force_item.h"
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
  if (!are_within_reach(sink->ungrown, pair)) return false;
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
  keep_pairs(&keep_scalars, last, removed, keep_filters, keep_exclusions, keep_stamps, boxes, ungrown, pairs, counts,
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
