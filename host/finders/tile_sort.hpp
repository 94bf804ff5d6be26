#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/threads.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Which slot is at which place of the tiles.
struct TileOrder {
  std::vector<std::uint32_t> slots;   // by place; no_slot where a tile has no more
  std::vector<std::uint32_t> places;  // by slot; no_slot for one without a box
  bool is_by_filter = false;          // whether filters decided which objects share tiles
};

/// Sorts all slots that have boxes, such that neighbours in space mostly share a tile, and neighbouring tiles
/// a node: into the order of a k-d tree. May do so in several steps, between which boxes may change; it then
/// sorts the boxes as they were.
/// @tparam axes 4 if the order depends on worlds or sets, too; otherwise 3.
template <std::size_t axes>
class TileSort {
 public:
  /// Reads all boxes.
  /// @throws std::bad_alloc
  TileSort(const Input& input, const Threads& threads);

  /// The work that is to be done after that, in comparisons.
  [[nodiscard]] std::size_t work() const noexcept;
  /// Does a part of the work.
  /// @returns Whether all is done.
  /// @throws std::bad_alloc Then this object must not be used any more.
  bool advance(std::size_t work, const Threads& threads);
  /// The order, when all is done.
  [[nodiscard]] TileOrder& order() noexcept { return order_; }

 private:
  /// The position of a box.
  struct alignas(axes == 3 ? 16 : alignof(float)) Centre {
    std::array<float, axes> at;
    std::uint32_t slot;
  };
  /// Centres that are to be sorted.
  struct Node {
    std::span<Centre> from;
    std::span<Centre> to;  // memory for them
    std::span<std::int32_t> keys;
    std::size_t first;  // place
  };

  static std::size_t work_of(const Node& node) noexcept;
  static std::size_t widest_axis(std::span<const Centre> centres);
  static std::array<Node, 2> halves_of(const Node& node);
  static void partition(const Node& node, std::size_t middle);
  void sort(const Node& node);
  void place(std::span<const Centre> centres, std::size_t first);

  std::unique_ptr<Centre[]> centres_, others_;  // NOLINT(modernize-avoid-c-arrays): not initialised
  std::unique_ptr<std::int32_t[]> keys_;        // NOLINT(modernize-avoid-c-arrays)
  TileOrder order_;
  std::vector<Node> pending_;
};

}  // namespace broadcl
