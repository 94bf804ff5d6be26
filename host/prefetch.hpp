#pragma once

#include <cstddef>

#if defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
#include <xmmintrin.h>
#endif

namespace broadcl {

/// Begins to load a line of memory into the processor's cache, where the compiler can say so. Any address
/// will do, even one at which there is nothing.
inline void prefetch(const void* address) noexcept {
#if defined(__GNUC__)
  __builtin_prefetch(address);
#elif defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
  _mm_prefetch(static_cast<const char*>(address), _MM_HINT_T0);
#else
  (void)address;
#endif
}

/// The same for all lines of some bytes; nothing if the address is null.
inline void prefetch(const void* address, std::size_t bytes) noexcept {
  if (address == nullptr) return;
  constexpr std::size_t line = 64;
  for (std::size_t at = 0; at < bytes; at += line) prefetch(static_cast<const char*>(address) + at);
}

}  // namespace broadcl
