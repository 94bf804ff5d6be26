#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>

#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/packed_box.hpp"
#include "base/pair_lists.hpp"
#include "base/threads.hpp"
#include "core/pair_index.hpp"
#include "engines/algorithm.hpp"
#include "engines/change_lists.hpp"

namespace broadcl {

/// Appends those of some pairs whose boxes are not within the sum of their reaches.
template <class Box, class Reach>
[[gnu::noinline]] void append_apart(std::span<const Pair> pairs, const Box& box, const Reach& reach,
                                    std::vector<Pair>& to) {
  for (const Pair& pair : pairs) {
    if (!is_within(box(pair.a), box(pair.b), reach(pair.a) + reach(pair.b))) to.push_back(pair);
  }
}

/// Those of some pairs whose boxes are not within the sum of their reaches, in canonical order.
/// @param box Returns a box in double precision that is not empty, by slot.
/// @param reach Returns its reach.
/// @param threads At most; 0 for one per processor.
/// @throws std::bad_alloc
template <class Box, class Reach>
[[nodiscard]] std::vector<Pair> pairs_apart(std::span<const Pair> pairs, const Threads& threads,
                                            const Box& box, const Reach& reach) {
  std::vector<Pair> apart =
      select_pairs(pairs, threads, [&](std::span<const Pair> part, std::vector<Pair>& selected) {
        const DefaultFloatingPoint as_everywhere;
        append_apart(part, box, reach, selected);
      });
  if (!std::ranges::is_sorted(apart)) std::ranges::sort(apart);
  return apart;
}

/// Turns the pairs and changes of an algorithm into those in double precision: the pairs that touch as
/// float32 are compared, and it is remembered which are apart.
class ExactPairs {
 public:
  /// @param threads That compare pairs, at most; 0 for one per processor.
  explicit ExactPairs(const Threads& threads) : threads_(threads), parts_(threads) {}

  /// To be called before each update of the algorithm.
  /// @throws As Algorithm::pairs(); nothing has changed then.
  void begin(Algorithm& algorithm);
  /// To be called after it. If this throws, all() still returns the pairs that were last reported, and all
  /// slots must count as changed in the next update.
  /// @param found The changes of the algorithm.
  /// @param changed The slots that changed, of which `recycled` are counted from the last success on.
  /// @param axes On which bounds may be told apart only in double precision.
  /// @param boxes, reaches Of the update, by slot; no reaches if there are none.
  /// @returns The changes since the last success.
  /// @throws As Algorithm::touching() and Algorithm::pairs(); std::bad_alloc.
  Delta finish(Algorithm& algorithm, const Delta& found, const SlotChanges& changed, AxisSet axes,
               std::span<const Aabb64> boxes, std::span<const double> reaches);

  /// All pairs as of the last success.
  /// @throws As Algorithm::pairs(); std::bad_alloc.
  [[nodiscard]] std::vector<Pair> all(Algorithm& algorithm) const;
  /// How many pairs touch as float32, but are apart.
  [[nodiscard]] std::size_t apart() const noexcept { return apart_.size(); }

  /// Frees what the next update does not need.
  /// @throws std::bad_alloc; nothing has changed then.
  void shrink();

 private:
  Threads threads_;
  PairIndex apart_;  // of the pairs of the algorithm
  PairParts parts_;
  ChangeLists lists_;
  // Since the last success, if something failed: changes of the algorithm, and later the pairs before them.
  std::optional<Delta> unreported_;
  std::optional<std::vector<Pair>> reported_;
};

}  // namespace broadcl
