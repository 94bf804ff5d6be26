#include "core/exact_pairs.hpp"

#include <algorithm>
#include <utility>

#include "base/pair_lists.hpp"
#include "base/parallel.hpp"
#include "base/prefetch.hpp"

namespace broadcl {
void ExactPairs::list_touching(std::vector<Pair> pairs) {
  next_.apart = select_pairs(pairs, threads_, [&](std::span<const Pair> part, std::vector<Pair>& apart) {
    constexpr std::size_t ahead = 8;
    for (std::size_t k = 0; k < part.size(); ++k) {
      if (k + ahead < part.size()) prefetch(&next_.boxes[part[k + ahead].a]);
      if (!overlaps(next_.boxes[part[k].a], next_.boxes[part[k].b])) apart.push_back(part[k]);
    }
  });
  if (!std::ranges::is_sorted(next_.apart)) std::ranges::sort(next_.apart);
  next_.touching = std::move(pairs);
  next_.is_listed = true;
}

void ExactPairs::expect_changes(std::size_t added, std::size_t removed) {
  if (apart_.empty() && next_.apart.empty()) return;
  const std::size_t edits = apart_.size() + next_.apart.size();
  next_.added_edits.reserve(edits);
  next_.removed_edits.reserve(edits);
  const auto reserve = [&](std::vector<Pair>& added_pairs, std::vector<Pair>& removed_pairs) {
    added_pairs.reserve(added + apart_.size());
    removed_pairs.reserve(removed + next_.apart.size());
    next_.added = &added_pairs;
    next_.removed = &removed_pairs;
  };
  next_.owner = lists_.fill(reserve).owner;
}

void ExactPairs::compare_again() {
  if (next_.is_listed) return;
  list_touching(touching_);
  expect_changes(0, 0);
}

Delta ExactPairs::commit(const Delta& found) noexcept {
  if (next_.is_listed) touching_.swap(next_.touching);
  if (next_.added == nullptr) return found;
  // A pair that stays with the core may come together or apart, too.
  find_edits(found.added, next_.apart, apart_, found.removed, next_.added_edits);
  find_edits(found.removed, apart_, next_.apart, found.added, next_.removed_edits);
  apart_.swap(next_.apart);
  if (next_.added_edits.empty() && next_.removed_edits.empty()) return found;
  apply(found.added, next_.added_edits, *next_.added);
  apply(found.removed, next_.removed_edits, *next_.removed);
  lists_.commit();
  return {.added = *next_.added, .removed = *next_.removed, .owner = next_.owner};
}

/// All lists are in canonical order.
/// @param except Pairs that are not to be among the changes.
/// @param turned Others that are, unless they are among the opposite changes.
void ExactPairs::find_edits(std::span<const Pair> changes, std::span<const Pair> except,
                            std::span<const Pair> turned, std::span<const Pair> opposite,
                            std::vector<Edit>& edits) noexcept {
  auto at = changes.begin();
  for (auto next = except.begin(), other = turned.begin(); next != except.end() || other != turned.end();) {
    const bool is_exception = other == turned.end() || (next != except.end() && !(*other < *next));
    const Pair pair = is_exception ? *next++ : *other++;
    if (is_exception && other != turned.end() && *other == pair) ++other;
    at = std::lower_bound(at, changes.end(), pair);
    const auto from = static_cast<std::size_t>(at - changes.begin());
    const bool is_there = at != changes.end() && *at == pair;
    if (is_exception ? !is_there : std::ranges::binary_search(opposite, pair)) continue;
    const std::size_t to = edits.empty() ? from : edits.back().next_to() + from - edits.back().next_from();
    edits.push_back({from, to, pair, !is_exception});
  }
}

/// Several threads copy what is between the edits.
void ExactPairs::apply(std::span<const Pair> changes, std::span<const Edit> edits,
                       std::vector<Pair>& out) const noexcept {
  constexpr std::size_t most_parts = 64;
  constexpr std::size_t pairs_per_thread = 1 << 14;  // at least
  const std::size_t edits_per_part = edits.size() / most_parts + 1;
  const std::size_t parts = edits.size() / edits_per_part + 1;
  const std::size_t tail = changes.size() - (edits.empty() ? 0 : edits.back().next_from());
  out.resize((edits.empty() ? 0 : edits.back().next_to()) + tail);
  parallel_for(parts, useful_threads(changes.size(), pairs_per_thread, threads_),
               [&](std::size_t part, std::size_t /*thread*/) {
                 const std::size_t first = part * edits_per_part;
                 const std::size_t end = std::min(edits.size(), first + edits_per_part);
                 std::size_t from = first == 0 ? 0 : edits[first - 1].next_from();
                 auto to =
                     out.begin() + static_cast<std::ptrdiff_t>(first == 0 ? 0 : edits[first - 1].next_to());
                 for (const Edit& edit : edits.subspan(first, end - first)) {
                   to = std::ranges::copy(changes.subspan(from, edit.from - from), to).out;
                   if (edit.is_inserted) *to++ = edit.pair;
                   from = edit.next_from();
                 }
                 if (end == edits.size()) std::ranges::copy(changes.subspan(from), to);
               });
}

std::vector<Pair> ExactPairs::overlapping(std::vector<Pair> pairs) const {
  return apart_.empty() ? std::move(pairs) : difference(pairs, apart_);
}

void ExactPairs::shrink() noexcept {
  next_ = {};
  lists_.clear();
}

}  // namespace broadcl
