#pragma once

#if defined(__SSE2_MATH__) && defined(__x86_64__)
#include <xmmintrin.h>
#else
#include <cfenv>
#endif

#include "base/non_copyable.hpp"

namespace broadcl {

/// While it exists, the calling thread rounds to the nearest number, has denormal numbers, and no operation
/// traps, whatever its owner has set; then everything is as before. So all threads compute the same.
///
/// Operations must stand in functions that are not inlined, or a compiler may move them out of its life.
class DefaultFloatingPoint : NonCopyable {
 public:
#if defined(__SSE2_MATH__) && defined(__x86_64__)
  /// (std::fesetenv() would take ten times as long, since it also sets the older unit, which nothing uses.)
  DefaultFloatingPoint() noexcept : callers_(_mm_getcsr()) {
    constexpr unsigned at_start = 0x1f80;  // of a process
    _mm_setcsr(at_start);
  }
  ~DefaultFloatingPoint() {
    _mm_setcsr(callers_);
  }
#else
  DefaultFloatingPoint() noexcept {
    std::fegetenv(&callers_);
    std::fesetenv(FE_DFL_ENV);
  }
  ~DefaultFloatingPoint() {
    std::fesetenv(&callers_);
  }
#endif

 private:
#if defined(__SSE2_MATH__) && defined(__x86_64__)
  unsigned callers_;
#else
  std::fenv_t callers_{};
#endif
};

}  // namespace broadcl
