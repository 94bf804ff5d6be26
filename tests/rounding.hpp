#pragma once

#include <array>
#include <cfenv>

#ifdef __SSE2__
#include <xmmintrin.h>
#endif

namespace broadcl::test {

inline constexpr std::array rounding_modes{FE_TONEAREST, FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};

/// Sets the rounding mode of this thread while it exists.
class ScopedRounding {
 public:
  explicit ScopedRounding(int mode) { std::fesetround(mode); }
  ~ScopedRounding() { std::fesetround(before_); }
  ScopedRounding(const ScopedRounding&) = delete;
  ScopedRounding& operator=(const ScopedRounding&) = delete;
  ScopedRounding(ScopedRounding&&) = delete;
  ScopedRounding& operator=(ScopedRounding&&) = delete;

 private:
  int before_ = std::fegetround();
};

#ifdef __SSE2__
/// While it exists, this thread takes denormal numbers for zeros.
class ScopedFlush {
 public:
  ScopedFlush() {
    constexpr unsigned flush_to_zero = 0x8000;
    constexpr unsigned denormals_are_zero = 0x0040;
    _mm_setcsr(before_ | flush_to_zero | denormals_are_zero);
  }
  ~ScopedFlush() { _mm_setcsr(before_); }
  ScopedFlush(const ScopedFlush&) = delete;
  ScopedFlush& operator=(const ScopedFlush&) = delete;
  ScopedFlush(ScopedFlush&&) = delete;
  ScopedFlush& operator=(ScopedFlush&&) = delete;

 private:
  unsigned before_ = _mm_getcsr();
};
#endif

}  // namespace broadcl::test
