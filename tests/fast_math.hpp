#pragma once

#include <broadcl/aabb.hpp>

namespace broadcl::test {

/// The answers in a user's program.
struct Answers {
  bool has_nan;
  bool is_empty;
  bool overlap;

  friend bool operator==(const Answers&, const Answers&) = default;
};

/// About box s, and about s and t, from a translation unit that is compiled with -ffast-math.
[[nodiscard]] Answers fast_math_answers(const Aabb& s, const Aabb& t) noexcept;

}  // namespace broadcl::test
