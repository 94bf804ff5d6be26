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

#endif
