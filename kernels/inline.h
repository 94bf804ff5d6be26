#ifndef BROADCL_INLINE_H
#define BROADCL_INLINE_H

/* For functions with barriers. PoCL 3.1 gives wrong results if one is called from two places and not inlined.

   PoCL 3.1 to 6.0 also give wrong results if a loop that some work-items do not enter, such as
   `for (k = item; k < count; ...)`, is followed by a barrier that only some conditions lead to: all work-items then run
   its body at least once. So what follows such a loop is a barrier that is always passed.

   PoCL 6.0 may take the first value of a loop variable for the same in all work-items if it is computed before a
   barrier and the loop comes after it, as in `for (k = item * SIZE; ...)`. Whether it does depends on addresses in the
   compiler: two compilations of some ninety were wrong, and stay in PoCL's cache. Seen in refit() of tiles_build.cl,
   whose loop begins at 0 since.

   PoCL compiles what follows a barrier that only some conditions lead to once for each way there, so each further
   condition before it may multiply the time that it takes to compile the kernel. */
#define INLINE static inline __attribute__((always_inline))

#endif
