#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "base/back_off.hpp"
#include "base/hysteresis.hpp"
#include "engines/pair_delta.hpp"
#include "engines/search.hpp"
#include "opencl/api.hpp"

namespace broadcl {

/// What searches of tiles cost, in nodes and boxes that they visit, as counted on the device. The work grows
/// as boxes move away from those that they were sorted next to, so it tells when to sort again: when what it
/// exceeds the work after sorting by has cost as much as a sort.
class TileWork {
 public:
  static constexpr double default_sort_work = 3;

  /// @param node Boxes per tile.
  /// @param sort_work The work, per box, that takes as long as a sort.
  TileWork(std::size_t node, double sort_work) : node_(node), sort_work_(sort_work) {}

  /// Records the work of the last search, and that a frame begins.
  /// @returns Whether to sort the boxes for its search.
  [[nodiscard]] bool begin_frame(const Search& search, const PairDelta& sink);
  /// Records that the boxes of this frame are being sorted. Before that, call forget_sort(), because
  /// boxes that are partly sorted are not sorted.
  void set_sorted(const Search& search, const PairDelta& sink);
  void forget_sort() noexcept { sorted_slots_ = 0; }
  /// Records that the search was given up, for a sort.
  void give_up(const PairDelta& sink) noexcept { unsorted_.start(sink.frames()); }
  /// @param is_early Whether it searches the boxes of the last frame.
  void begin_search(const Search& search, bool is_early);

  /// Whether the last early search took less time than it saved.
  [[nodiscard]] bool early_pays() const noexcept;
  /// The work at which a search by this many work-groups is given up; the largest number if it must not be.
  [[nodiscard]] cl_uint most(const Search& search, const PairDelta& sink, std::size_t groups) const;

 private:
  /// Kinds of searches, whose work is compared separately: of the boxes that changed, of all boxes, and of
  /// all boxes as they were in the last frame.
  enum Kind : std::size_t { some_changed, all_changed, early };

  [[nodiscard]] double excess(const Search& search, const PairDelta& sink);
  [[nodiscard]] double sort_work(const Search& search) const;
  [[nodiscard]] double typical(const Search& search) const;
  [[nodiscard]] double typical(std::size_t slots, std::size_t changed) const;

  /// The work of these searches, if the boxes have one size, as a multiple of typical().
  static constexpr std::array default_factors{0.9, 0.25, 0.25};

  std::size_t node_;
  double sort_work_;
  std::size_t sorted_slots_ = 0;  // 0 if no boxes are sorted
  bool sorted_by_world_ = false;
  bool sorted_by_set_ = false;
  std::size_t sorted_frame_ = 0;
  std::optional<std::size_t> searched_frame_;
  Hysteresis order_;         // whether to keep it
  BackOff unsorted_{32};     // searches without a sort
  Kind kind_ = all_changed;  // of the last search
  double typical_ = 1;       // for that search
  cl_uint moved_ = 0;        // boxes, in that search, if it did not sort
  // The work of searches of each kind, as a multiple of typical(): of the last ones, and of the first ones
  // since the boxes were sorted (0 if there was none).
  std::array<double, 3> factors_ = default_factors;
  std::array<double, 3> fresh_factors_{};
};

}  // namespace broadcl
