/* Boxes as the host packs them: six floats, lower x y z, upper x y z. */
#ifndef BROADCL_AABB_H
#define BROADCL_AABB_H

#define AABB_FLOATS 6

/* Whether boxes s and t overlap: closed, so touching counts, and false as soon as a bound is NaN. For scalars it
   gives 0 or 1, for vectors 0 or -1 per lane. */
#define AABB_OVERLAPS(s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y, \
                      t_lower_z, t_upper_x, t_upper_y, t_upper_z)                                             \
  (((s_lower_x) <= (t_upper_x)) & ((t_lower_x) <= (s_upper_x)) & ((s_lower_y) <= (t_upper_y)) &               \
   ((t_lower_y) <= (s_upper_y)) & ((s_lower_z) <= (t_upper_z)) & ((t_lower_z) <= (s_upper_z)))

/* A box in registers. */
typedef struct {
  float bound[AABB_FLOATS];
} box_t;

/* (Not returned as a value: Oclgrind 21.10 does not support what its compiler makes of that in a function that was
   inlined twice.) */
static inline void load_box(box_t* box, global const float* boxes, const uint slot) {
  global const float2* p = (global const float2*)(boxes + (size_t)slot * AABB_FLOATS);
  for (uint i = 0; i < AABB_FLOATS / 2U; ++i) {
    const float2 two = p[i];
    box->bound[2U * i] = two.x;
    box->bound[2U * i + 1U] = two.y;
  }
}

/* A box that overlaps nothing. */
static inline void make_empty(box_t* box) {
  for (uint i = 0; i < AABB_FLOATS; ++i) box->bound[i] = NAN;
}

static inline bool boxes_overlap(const box_t* s, const box_t* t) {
  return AABB_OVERLAPS(s->bound[0], s->bound[1], s->bound[2], s->bound[3], s->bound[4], s->bound[5], t->bound[0],
                       t->bound[1], t->bound[2], t->bound[3], t->bound[4], t->bound[5]) != 0;
}

#endif
