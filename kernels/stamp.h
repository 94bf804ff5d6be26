/* Which slots changed in which frame: one word per slot, with the frame's number in the upper 31 bits, and in the
   lowest bit whether the slot has another object than in the frame before. Frames are counted from 1, so that 0 is no
   frame. Valid OpenCL C and C++, so that host and kernels use the same words. */
#ifndef BROADCL_STAMP_H
#define BROADCL_STAMP_H

enum { LAST_STAMP = 0x7fffffff };

/* The number of a frame, or a slot, with that bit. */
static inline uint with_recycled(const uint number, const uint recycled) {
  return number << 1 | recycled;
}

static inline bool is_changed(const uint word, const uint stamp) {
  return word >> 1 == stamp;
}

static inline bool is_recycled(const uint word, const uint stamp) {
  return word == with_recycled(stamp, 1);
}

#endif
