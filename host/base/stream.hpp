#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace broadcl {

/// Copies boxes to memory that the processor does not read soon: without reading it first, and without
/// displacing others from its caches. finish_stream() must follow before another thread reads it.
template <class Box>
void stream(std::span<const Box> boxes, Box* to) noexcept {
#ifdef __SSE2__
  if (boxes.size_bytes() % sizeof(__m128i) == 0 &&
      reinterpret_cast<std::uintptr_t>(to) % sizeof(__m128i) == 0) {
    const auto* from = reinterpret_cast<const __m128i*>(boxes.data());
    auto* out = reinterpret_cast<__m128i*>(to);
    for (std::size_t k = 0; k < boxes.size_bytes() / sizeof(__m128i); ++k) {
      _mm_stream_si128(out + k, _mm_loadu_si128(from + k));
    }
    return;
  }
#endif
  std::ranges::copy(boxes, to);
}

inline void finish_stream() noexcept {
#ifdef __SSE2__
  _mm_sfence();
#endif
}

}  // namespace broadcl
