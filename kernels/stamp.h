/* Which slots changed in which frame: one word per slot, with the frame's number in the upper 31 bits, and in the
   lowest bit whether the slot has another object than in the frame before. Frames are counted from 1, so that 0 is no
   frame. */
#ifndef BROADCL_STAMP_H
#define BROADCL_STAMP_H

static inline bool is_changed(const uint word, const uint stamp) {
  return word >> 1 == stamp;
}

static inline bool is_recycled(const uint word, const uint stamp) {
  return word == (stamp << 1 | 1U);
}

#endif
