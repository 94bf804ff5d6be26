#ifndef BROADCL_INLINE_H
#define BROADCL_INLINE_H

/* For functions with barriers. PoCL 3.1 gives wrong results if one is called from two places and not inlined.

   PoCL 3.1 to 6.0 also give wrong results if a loop that some work-items do not enter, such as
   `for (k = item; k < count; ...)`, is followed by a barrier that only some conditions lead to: all work-items then run
   its body at least once. So what follows such a loop is a barrier that is always passed.

   PoCL 6.0 may take it for the same in all work-items where a loop begins that comes after a barrier, although that
   follows from the work-item, as in `for (k = item * SIZE; ...)`. Whether it does depends on addresses in the compiler:
   one compilation in some fifty is wrong, and stays in PoCL's cache. So such loops begin at 0.

   PoCL compiles what follows a barrier that only some conditions lead to once for each way there, so each further
   condition before it may multiply the time that it takes to compile the kernel. */
#define INLINE static inline __attribute__((always_inline))

#endif
