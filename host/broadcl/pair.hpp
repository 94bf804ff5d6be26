#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <compare>
#include <cstdint>
#include <memory>
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
/// same pair of ids may be in both lists.
///
/// The lists stay unchanged as long as this object or a copy of it exists, even if further updates follow or
/// the BroadPhase is destroyed. The next updates then use other memory, which takes longer if more than the
/// last Delta is kept; that memory may be much larger than the lists. A span alone is valid until the next
/// finish(), update() or shrink() of the BroadPhase, not only until begin().
struct Delta {
  std::span<const Pair> added{};
  std::span<const Pair> removed{};
  std::shared_ptr<const void> owner{};  ///< Of the memory of both; null if nothing had moved.
};

}  // namespace broadcl

#endif
