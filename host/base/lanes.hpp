#pragma once

namespace broadcl {

/// A vector of the compiler. (In scalar form, or left to a compiler to vectorise, comparisons of boxes take
/// several times as long.)
using FourLanes [[gnu::vector_size(16)]] = float;

#ifdef _WIN32  // where GCC aligns no more than 16 bytes on the stack
using EightLanes = FourLanes;
#else
using EightLanes [[gnu::vector_size(32)]] = float;
#endif

// For functions that are compiled twice, for any processor and for those with AVX2, so they must be inlined:
// unless sanitizers check them, which takes Clang minutes then, and finds the same faults.
#ifdef __has_feature
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BROADCL_INLINE inline
#define BROADCL_INLINE_LAMBDA
#endif
#endif
#ifndef BROADCL_INLINE
#define BROADCL_INLINE [[gnu::always_inline]] inline
#define BROADCL_INLINE_LAMBDA __attribute__((always_inline))
#endif

}  // namespace broadcl
