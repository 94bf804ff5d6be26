/* Packed boxes, as the host makes them: six floats, lower x y z, upper x y z. */
#ifndef BROADCL_AABB_H
#define BROADCL_AABB_H

#define AABB_FLOATS 6

#ifndef FLUSHES
#define FLUSHES 0 /* 1 if the device takes denormal numbers for zeros: arithmetic.cl */
#endif

/* 1 if boxes are the caller's, which may be improper: load_box() then takes those for empty. */
#ifndef CALLERS_BOXES
#define CALLERS_BOXES 0
#endif

/* Whether s <= t, which is false for a NaN: 0 or 1. */
#if FLUSHES
static inline int not_above(const float s, const float t) {
  /* Floats as integers in the same order; integers beyond the infinities are NaNs. */
  const int x = as_int(s) < 0 ? INT_MIN - as_int(s) : as_int(s);
  const int y = as_int(t) < 0 ? INT_MIN - as_int(t) : as_int(t);
  return (x <= y) & (x >= -as_int(INFINITY)) & (y <= as_int(INFINITY));
}
#define NOT_ABOVE(s, t) not_above(s, t)
#else
#define NOT_ABOVE(s, t) ((s) <= (t))
#endif

/* Whether the closed boxes s and t overlap: 0 or 1. Touching counts; 0 if a bound is NaN. */
#define AABB_OVERLAPS(s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y,         \
                      t_lower_z, t_upper_x, t_upper_y, t_upper_z)                                                     \
  AABB_OVERLAPS_BY(NOT_ABOVE, s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y, \
                   t_lower_z, t_upper_x, t_upper_y, t_upper_z)
#define AABB_OVERLAPS_BY(test, s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y, \
                         t_lower_z, t_upper_x, t_upper_y, t_upper_z)                                                   \
  (test(s_lower_x, t_upper_x) & test(t_lower_x, s_upper_x) & test(s_lower_y, t_upper_y) & test(t_lower_y, s_upper_y) & \
   test(s_lower_z, t_upper_z) & test(t_lower_z, s_upper_z))

/* A box in registers. */
typedef struct {
  float bound[AABB_FLOATS];
} box_t;

/* A box that overlaps nothing. */
static inline void make_empty(box_t* box) {
  for (uint i = 0; i < AABB_FLOATS; ++i) box->bound[i] = NAN;
}

/* Whether no bound is NaN, and no upper one is below the lower one. */
static inline bool is_proper(const box_t* box) {
  return (NOT_ABOVE(box->bound[0], box->bound[3]) & NOT_ABOVE(box->bound[1], box->bound[4]) &
          NOT_ABOVE(box->bound[2], box->bound[5])) != 0;
}

/* (Not returned as a value: Oclgrind 21.10 does not support the resulting code if the function is inlined twice.) */
static inline void load_box(box_t* box, global const float* boxes, const uint slot) {
  global const float2* p = (global const float2*)(boxes + (size_t)slot * AABB_FLOATS);
  for (uint i = 0; i < AABB_FLOATS / 2U; ++i) {
    const float2 two = p[i];
    box->bound[2U * i] = two.x;
    box->bound[2U * i + 1U] = two.y;
  }
#if CALLERS_BOXES
  if (!is_proper(box)) make_empty(box);
#endif
}

static inline bool boxes_overlap(const box_t* s, const box_t* t) {
  return AABB_OVERLAPS(s->bound[0], s->bound[1], s->bound[2], s->bound[3], s->bound[4], s->bound[5], t->bound[0],
                       t->bound[1], t->bound[2], t->bound[3], t->bound[4], t->bound[5]) != 0;
}

#endif
