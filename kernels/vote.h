/* A vote of the work-items of a work-group, one for each child of a node. */
#ifndef BROADCL_VOTE_H
#define BROADCL_VOTE_H

#include "bits.h"
#include "inline.h"
#include "tiles.h"

/* The ballots of the last vote and of this one. */
typedef struct {
  uint4 bytes[2][NODE / sizeof(uint4)];
} ballots_t;

/* One bit per work-item: whether it voted yes. All work-items must call it. `turn` is 0 before the first vote. There
   must be a barrier between any two votes, so that nothing is overwritten that a slow work-item still reads. */
INLINE mask_t vote(const bool yes, local ballots_t* ballots, uint* turn) {
#ifdef NVIDIA
  (void)ballots;
  (void)turn;
  uint bits;
  __asm__ volatile("{ .reg .pred p; setp.ne.u32 p, %1, 0; vote.sync.ballot.b32 %0, p, 0xffffffff; }"
                   : "=r"(bits)
                   : "r"((uint)yes));
  return bits;
#else
  local uint4* box = ballots->bytes[*turn];
  *turn = 1U - *turn;
  ((local uchar*)box)[get_local_id(0)] = yes ? 1 : 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  const uint first = bits_of_16(box[0]) | bits_of_16(box[1]) << 16;
#if GROUP == 64
  return (mask_t)(bits_of_16(box[2]) | bits_of_16(box[3]) << 16) << 32 | first;
#else
  return first;
#endif
#endif
}

#endif
