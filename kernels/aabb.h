/* Boxes as the host packs them: six floats, lower x y z, upper x y z. */
#ifndef BROADCL_AABB_H
#define BROADCL_AABB_H

#define AABB_FLOATS 6

/* Whether boxes s and t overlap: closed, so touching counts, and false as soon as a bound is NaN. Of scalars it gives
   0 or 1, of vectors 0 or -1 a lane. */
#define AABB_OVERLAPS(s_lower_x, s_lower_y, s_lower_z, s_upper_x, s_upper_y, s_upper_z, t_lower_x, t_lower_y,     \
                      t_lower_z, t_upper_x, t_upper_y, t_upper_z)                                                 \
  (((s_lower_x) <= (t_upper_x)) & ((t_lower_x) <= (s_upper_x)) & ((s_lower_y) <= (t_upper_y)) &                   \
   ((t_lower_y) <= (s_upper_y)) & ((s_lower_z) <= (t_upper_z)) & ((t_lower_z) <= (s_upper_z)))

/* A box in registers. */
typedef struct {
  float bound[AABB_FLOATS];
} box_t;

static inline box_t load_box(global const float* boxes, const uint slot) {
  global const float2* p = (global const float2*)(boxes + (size_t)slot * AABB_FLOATS);
  const float2 p0 = p[0];
  const float2 p1 = p[1];
  const float2 p2 = p[2];
  const box_t box = {{p0.x, p0.y, p1.x, p1.y, p2.x, p2.y}};
  return box;
}

/* Overlaps nothing. */
static inline box_t empty_box(void) {
  const box_t box = {{NAN, NAN, NAN, NAN, NAN, NAN}};
  return box;
}

static inline bool boxes_overlap(const box_t* s, const box_t* t) {
  return AABB_OVERLAPS(s->bound[0], s->bound[1], s->bound[2], s->bound[3], s->bound[4], s->bound[5], t->bound[0],
                       t->bound[1], t->bound[2], t->bound[3], t->bound[4], t->bound[5]) != 0;
}

#endif
