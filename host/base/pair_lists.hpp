#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/error.hpp>
#include <broadcl/pair.hpp>

#include "base/free_lists.hpp"
#include "base/parallel.hpp"
#include "base/slot_set.hpp"
#include "base/system.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// The largest number of pairs that may overlap: indices of kernels are 32-bit numbers.
inline constexpr std::size_t most_pairs = std::size_t{1} << 31;

/// @throws Error if so many pairs overlap.
inline void refuse_too_many(std::size_t pairs) {
  if (pairs > most_pairs)
    throw Error("more than " + std::to_string(most_pairs) + " pairs overlap; use fewer boxes");
}

/// Makes a list large enough. Most of the time that a long new list takes is spent in page faults, so it gets
/// large pages.
/// @throws std::bad_alloc; the list is empty then, or as before.
inline void reserve_for_writing(std::vector<Pair>& pairs, std::size_t n) {
  if (n <= pairs.capacity()) return;
  pairs.clear();
  pairs.reserve(std::max(n, pairs.capacity() + pairs.capacity() / 2));
  use_large_pages(pairs.data(), pairs.capacity() * sizeof(Pair));
}

/// Resizes a list that is to be overwritten.
/// @throws As reserve_for_writing() does.
inline void resize_for_writing(std::vector<Pair>& pairs, std::size_t n) {
  reserve_for_writing(pairs, n);
  pairs.resize(n);
}

/// @throws std::bad_alloc
[[nodiscard]] inline std::vector<Pair> copy_of(std::span<const Pair> pairs) {
  std::vector<Pair> copy;
  reserve_for_writing(copy, pairs.size());
  copy.assign(pairs.begin(), pairs.end());
  return copy;
}

// Lists of pairs as sets: each in canonical order, without duplicates.

/// The first pair from `first` on that does not precede another one. (The steps double, since it may be near
/// or far.)
[[nodiscard]] inline const Pair* skip(const Pair* first, const Pair* end, const Pair& other) noexcept {
  for (std::ptrdiff_t step = 1; first != end && *first < other; step *= 2) {
    const Pair* const next = first + std::min(step, end - first);
    first = *(next - 1) < other ? next : std::lower_bound(first, next, other);
  }
  return first;
}

/// Walks through two lists at the same time.
/// @param in_s, in_t, in_both Called with runs of pairs that are only in that list, or in both; together they
/// are all pairs, in canonical order.
template <class InS, class InT, class InBoth>
void walk(std::span<const Pair> s, std::span<const Pair> t, const InS& in_s, const InT& in_t,
          const InBoth& in_both) {
  const auto run = [](const auto& function, const Pair* first, const Pair* end) {
    if (first != end) function(std::span(first, end));
    return end;
  };
  const Pair* p = s.data();
  const Pair* q = t.data();
  const Pair* const p_end = p + s.size();
  const Pair* const q_end = q + t.size();
  for (;;) {
    const auto [p_next, q_next] = std::mismatch(p, p_end, q, q_end);
    run(in_both, p, p_next);
    p = p_next;
    q = q_next;
    if (p == p_end || q == q_end) break;
    p = run(in_s, p, skip(p, p_end, *q));
    if (p == p_end) break;
    q = run(in_t, q, skip(q, q_end, *p));
  }
  run(in_s, p, p_end);
  run(in_t, q, q_end);
}

/// For walk(): appends runs to a list.
[[nodiscard]] inline auto append_to(std::vector<Pair>& list) noexcept {
  return [&list](std::span<const Pair> run) { list.insert(list.end(), run.begin(), run.end()); };
}
/// For walk(): leaves runs out.
inline constexpr auto leave_out = [](std::span<const Pair> /*run*/) {};

[[nodiscard]] inline std::vector<Pair> difference(std::span<const Pair> from, std::span<const Pair> without) {
  std::vector<Pair> result;
  walk(from, without, append_to(result), leave_out, leave_out);
  return result;
}

[[nodiscard]] inline std::vector<Pair> merge(std::span<const Pair> s, std::span<const Pair> t) {
  std::vector<Pair> result;
  walk(s, t, append_to(result), append_to(result), append_to(result));
  return result;
}

[[nodiscard]] inline std::vector<Pair> intersection(std::span<const Pair> s, std::span<const Pair> t) {
  std::vector<Pair> result;
  walk(s, t, leave_out, leave_out, append_to(result));
  return result;
}

/// The pairs that are in one of the lists only.
[[nodiscard]] inline std::vector<Pair> symmetric_difference(std::span<const Pair> s,
                                                            std::span<const Pair> t) {
  std::vector<Pair> result;
  walk(s, t, append_to(result), append_to(result), leave_out);
  return result;
}

/// difference() in place.
inline void subtract(std::vector<Pair>& pairs, std::span<const Pair> without) noexcept {
  Pair* kept = pairs.data();
  const auto keep = [&](std::span<const Pair> run) {
    kept = run.data() == kept ? kept + run.size() : std::ranges::copy(run, kept).out;
  };
  walk(pairs, without, keep, leave_out, leave_out);
  pairs.resize(static_cast<std::size_t>(kept - pairs.data()));
}

/// Two lists for each part of a long list that several threads work on.
class PairParts {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit PairParts(Threads threads) noexcept : threads_(std::move(threads)) {}

  /// Divides two lists at the same pairs, or one in any order. If that is not worth several threads, there is
  /// one part.
  /// @param work Called with a part of s, the part of t, and two lists to append pairs to.
  /// @param first, second Receive what was appended, part by part.
  /// @throws std::bad_alloc; what `work` throws.
  template <class Work>
  void operator()(std::span<const Pair> s, std::span<const Pair> t, const Work& work,
                  std::vector<Pair>& first, std::vector<Pair>& second) {
    constexpr std::size_t pairs_per_part = 2048;
    constexpr std::size_t pairs_per_thread = 4096;
    first.clear();
    second.clear();
    const std::span<const Pair> longer = s.size() > t.size() ? s : t;
    const Threads threads = useful_threads(longer.size(), pairs_per_thread, threads_);
    if (threads.most == 1) return work(s, t, first, second);
    const std::size_t parts = (longer.size() + pairs_per_part - 1) / pairs_per_part;
    if (parts_.size() < parts) parts_.resize(parts);
    parallel_for(parts, threads, [&](std::size_t k, std::size_t /*thread*/) {
      const auto part_of = [&](std::span<const Pair> list) {
        const auto start = [&](std::size_t part) {
          const std::size_t at = part * pairs_per_part;
          if (part == parts) return list.end();
          if (list.data() == longer.data()) return list.begin() + static_cast<std::ptrdiff_t>(at);
          return part == 0 ? list.begin() : std::ranges::lower_bound(list, longer[at]);
        };
        return std::span<const Pair>(start(k), start(k + 1));
      };
      parts_[k].first.clear();
      parts_[k].second.clear();
      work(part_of(s), part_of(t), parts_[k].first, parts_[k].second);
    });
    for (std::size_t k = 0; k < parts; ++k) {
      append_to(first)(parts_[k].first);
      append_to(second)(parts_[k].second);
    }
    if (first.size() + second.size() > longer.size()) free_scratch();
  }

  /// Frees memory that is only needed during a call.
  void free_scratch() noexcept { free_lists(parts_); }

 private:
  struct alignas(cache_line) Part {
    std::vector<Pair> first, second;
  };

  Threads threads_;
  std::vector<Part> parts_;
};

/// Finds which pairs were added and removed between two lists. Pairs of a recycled slot count as removed and,
/// if they are in both lists, as added again.
/// @param recycled Ascending.
/// @throws std::bad_alloc
inline void compare(std::span<const Pair> before, std::span<const Pair> now,
                    std::span<const std::uint32_t> recycled, PairParts& parts, std::vector<Pair>& added,
                    std::vector<Pair>& removed) {
  const SlotSet recycled_slots(recycled);
  const auto work = [&](std::span<const Pair> s, std::span<const Pair> t, std::vector<Pair>& gone,
                        std::vector<Pair>& come) {
    walk(s, t, append_to(gone), append_to(come), [&](std::span<const Pair> run) {
      if (recycled.empty()) return;
      for (const Pair& pair : run) {
        if (!recycled_slots.contains(pair.a) && !recycled_slots.contains(pair.b)) continue;
        gone.push_back(pair);
        come.push_back(pair);
      }
    });
  };
  const std::size_t longer = std::max(before.size(), now.size());
  if (std::min(before.size(), now.size()) >= longer / 4) return parts(before, now, work, removed, added);
  // Most pairs changed, and the lists of the parts would take as much memory as those that are wanted.
  added.clear();
  removed.clear();
  work(before, now, removed, added);
}

/// Some pairs of a list, which may be in any order, and stay in it, chosen by several threads if the list is
/// long.
/// @param threads At most; 0 for one per processor.
/// @param select Called with a part of the list and a list to append its pairs to.
/// @throws std::bad_alloc
template <class Select>
[[nodiscard]] std::vector<Pair> select_pairs(std::span<const Pair> pairs, const Threads& threads,
                                             const Select& select) {
  std::vector<Pair> selected;
  std::vector<Pair> none;
  PairParts parts(threads);
  parts(
      pairs, {},
      [&](std::span<const Pair> part, std::span<const Pair> /*t*/, std::vector<Pair>& own,
          std::vector<Pair>& /*none*/) { select(part, own); },
      selected, none);
  return selected;
}

/// Lists the pairs that have at least one of some slots.
/// @param is_one For each slot of a pair, 0 or 1.
/// @throws std::bad_alloc
inline void select_by_slots(std::span<const Pair> pairs, std::span<const std::uint8_t> is_one,
                            PairParts& parts, std::vector<Pair>& selected) {
  std::vector<Pair> none;
  const auto select = [&](std::span<const Pair> part, std::span<const Pair> /*t*/, std::vector<Pair>& own,
                          std::vector<Pair>& /*none*/) {
    constexpr std::size_t at_once = 512;
    std::array<Pair, at_once> some;
    while (!part.empty()) {
      std::size_t count = 0;
      const std::span<const Pair> next = part.first(std::min(at_once, part.size()));
      for (const Pair& pair : next) {  // few of them, at random: a branch would be slower
        some[count] = pair;
        count += static_cast<std::size_t>(is_one[pair.a] | is_one[pair.b]);
      }
      append_to(own)(std::span(some).first(count));
      part = part.subspan(next.size());
    }
  };
  constexpr std::size_t pairs_for_threads = 262144;  // with fewer, waking a thread takes longer
  if (pairs.size() >= pairs_for_threads) return parts(pairs, {}, select, selected, none);
  selected.clear();
  select(pairs, {}, selected, none);
}

}  // namespace broadcl
