#include "fast_math.hpp"

#if !defined(__FAST_MATH__) && !defined(_M_FP_FAST)
#error "this file must be compiled with -ffast-math"
#endif

namespace broadcl::test {

Answers fast_math_answers(const Aabb& s, const Aabb& t) noexcept {
  return {.has_nan = has_nan(s), .is_empty = is_empty(s), .overlap = overlaps(s, t)};
}

}  // namespace broadcl::test
