/* How functions are inlined. */
#ifndef BROADCL_INLINE_H
#define BROADCL_INLINE_H

/* For functions with barriers. PoCL 3.1 gives wrong results if one is called from two places and not inlined.

   PoCL 3.1 to 6.0 also give wrong results if a loop that some work-items do not enter, such as
   `for (k = item; k < count; ...)`, is followed by a barrier that only some conditions lead to: all work-items then run
   its body at least once. So what follows such a loop is a barrier that is always passed. */
#define INLINE static inline __attribute__((always_inline))

/* For functions that are rarely called, if NVIDIA's compiler would inline them and take registers for them from the rest
   of the kernel. Measure it: the call of a function may also cost registers. (A pointer that may be null is tested in
   such a function, not before the call: with driver 580, a kernel that did the latter failed.) */
#ifdef __NV_CL_C_VERSION
#define OUTLINE static inline __attribute__((noinline))
#else
#define OUTLINE static inline
#endif

#endif
