#pragma once

#include <broadcl/aabb.hpp>

namespace broadcl::test {

/// What a consumer's program sees.
struct Answers {
  bool has_nan;
  bool is_empty;
  bool overlap;

  friend bool operator==(const Answers&, const Answers&) = default;
};

/// Of box s, and of s and t, by a translation unit that is compiled with -ffast-math.
[[nodiscard]] Answers fast_math_answers(const Aabb& s, const Aabb& t) noexcept;

}  // namespace broadcl::test
