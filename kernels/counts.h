/* The counts of a frame, one word each. The number of added pairs has 64 bits in two words, so no 64-bit atomics are
   needed. Valid OpenCL C and C++, so that host and kernels use the same words. */
#ifndef BROADCL_COUNTS_H
#define BROADCL_COUNTS_H

enum {
  COUNT_KEPT,
  COUNT_REMOVED,
  COUNT_ADDED,
  COUNT_ADDED_HIGH,
  COUNT_WORK,          /* what an algorithm counts for itself */
  COUNT_UNORDERED,     /* not 0 if order_buckets.cl leaves the changes to the host */
  COUNT_INVALID,       /* boxes with a NaN bound, if boxes are gathered on the device */
  COUNT_INVALID_FIRST, /* UINT_MAX minus the index of the first of them */
  /* What a frame must know about earlier ones, so that frames can follow each other without the host: order.h passes
     it on. */
  COUNT_LAST_KEPT,    /* pairs at the beginning of the last complete frame's list */
  COUNT_LAST_ADDED,   /* and at its end */
  COUNT_LAST_TAG,     /* its tag, a number chosen by the host */
  COUNT_COMPLETE,     /* complete frames since the last one that was waited for */
  COUNT_HALTED,       /* not 0 if the frame before was not complete: then this one changes nothing either */
  COUNT_DISPLACEMENT, /* of near_pairs.cl: how far boxes have moved, at most, as a float */
  COUNT_GROWN,        /* of tiles_build.cl: tiles that are twice as long as in the last frame */
  COUNT_UNUSED,       /* so that the number of counts is even, and pairs can follow */
  COUNTS
};

/* In place of a displacement: there were more near pairs than fit. */
#define TOO_MANY_NEAR 0xffffffffU

#endif
