#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <compare>
#include <cstdint>
#include <span>

namespace broadcl {

/// Two overlapping boxes by id (BroadPhase) or by index in the array (overlapping_pairs): a < b, or, with two
/// sets, the index in the first and that in the second.
///
/// Pairs compare in canonical order: by b, then by a. With one set, that is the order of the triangular index
/// b(b-1)/2 + a. Every list of pairs that the library returns is in this order, on every device and in every
/// run, except changes that are sorted by world (ordered_worlds of DeviceBroadPhase::Boxes).
struct Pair {
  std::uint32_t a;
  std::uint32_t b;

  friend constexpr bool operator==(const Pair&, const Pair&) = default;
  friend constexpr std::strong_ordering operator<=>(const Pair& s, const Pair& t) noexcept {
    if (const auto by_b = s.b <=> t.b; std::is_neq(by_b)) return by_b;
    return s.a <=> t.a;
  }
};

/// What changed between two updates, each list in canonical order.
///
/// Apply `removed` first, then `added`: if an object was removed and a new one got its id in between, the
/// same pair of ids may be in both lists. The spans belong to the BroadPhase. They are valid until its next
/// finish(), update() or shrink(), not only until begin(); BroadPhase::delta_memory() keeps them longer.
struct Delta {
  std::span<const Pair> added;
  std::span<const Pair> removed;
};

}  // namespace broadcl

#endif
