#pragma once

#include <cstddef>

#if defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
#include <xmmintrin.h>
#endif

namespace broadcl {

/// Starts to load a cache line, if the compiler has an instruction for that. Any address is allowed, even an
/// invalid one.
inline void prefetch(const void* address) noexcept {
#if defined(__GNUC__)
  __builtin_prefetch(address);
#elif defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
  _mm_prefetch(static_cast<const char*>(address), _MM_HINT_T0);
#else
  (void)address;
#endif
}

/// The same for all cache lines of some bytes. No-op if the address is null.
inline void prefetch(const void* address, std::size_t bytes) noexcept {
  if (address == nullptr) return;
  constexpr std::size_t line = 64;
  for (std::size_t at = 0; at < bytes; at += line) prefetch(static_cast<const char*>(address) + at);
}

}  // namespace broadcl
