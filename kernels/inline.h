/* For functions with barriers: PoCL 3.1 gives wrong results if one is called from two places and not inlined. */
#ifndef BROADCL_INLINE_H
#define BROADCL_INLINE_H

#define INLINE static inline __attribute__((always_inline))

#endif
