#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/threads.hpp"
#include "engines/algorithm.hpp"
#include "finders/tile_search.hpp"
#include "finders/tile_sort.hpp"

namespace broadcl {

/// Boxes in tiles, first in an order of TileSort. A box that leaves its tile is put into the tile that grows
/// least, and what is full is divided, so tiles stay small while boxes come, go and leap (Guttman, "R-Trees:
/// A Dynamic Index Structure for Spatial Searching", SIGMOD 1984). If a function throws, start() must follow.
template <std::size_t axes>
class TileTree {
 public:
  TileTree(bool sets, bool reaches) {
    all_.sets = sets;
    all_.reaches = reaches;
  }

  [[nodiscard]] HostTiles<axes>& tiles() noexcept { return all_; }
  [[nodiscard]] const HostTiles<axes>& tiles() const noexcept { return all_; }
  /// The boxes that have a place in a tile.
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  /// Greater than every slot that has a place.
  [[nodiscard]] std::size_t slots() const noexcept { return places_.size(); }
  /// The place of a slot; no_slot if it has none.
  [[nodiscard]] std::uint32_t place_of(std::uint32_t slot) const noexcept {
    return slot < places_.size() ? places_[slot] : no_slot;
  }

  /// Takes another order, whose boxes are to be read. Those that are not in it have no place yet.
  /// @throws std::bad_alloc
  void start(TileOrder& order, const Input& input);

  /// Whether most of a sample of boxes have left their tiles, so that read() would be in vain.
  [[nodiscard]] bool is_abandoned(const Input& input) const;
  /// Reads boxes that changed or were not read yet.
  /// @param most How many nodes are read for the first time.
  /// @returns Whether all have been read.
  /// @throws std::bad_alloc
  bool read(const Input& input, std::size_t most, const Threads& threads);

  /// Slots that are new, or have left their tiles, and have no place until insert().
  [[nodiscard]] std::span<const std::uint32_t> left() const noexcept { return left_; }
  /// Makes a slot leave its tile, if it has one.
  /// @throws std::bad_alloc
  void take_out(std::uint32_t slot);
  /// @throws std::bad_alloc
  void insert(const Input& input);

 private:
  /// Of a tile.
  struct Occupancy {
    Bounds<axes> home;      // a box that reaches beyond it leaves the tile
    std::uint32_t taken;    // a bit for each place that has a box
    std::uint32_t unread;   // whose box is to be read
    std::uint32_t leaving;  // whose box leaves
  };

  void resize(std::size_t tiles);
  void find_left(const Input& input);
  template <class Function>
  void for_each_unread(std::size_t node, const Function& function);
  void start_tile(std::size_t tile);
  void read_tile(const Input& input, std::size_t tile);
  void update_node(std::size_t node, std::uint32_t children);
  void update_root(std::size_t root);
  void clear_place(std::size_t place);
  void set_place(const Input& input, std::size_t place, const Bounds<axes>& box, std::uint32_t slot);
  void insert(const Input& input, std::uint32_t slot);
  [[nodiscard]] std::size_t empty_tile(std::size_t node);
  void divide_tile(const Input& input, std::size_t tile, std::size_t other);
  void divide_node(std::size_t node);

  HostTiles<axes> all_;
  std::vector<Occupancy> occupancy_;   // by tile
  std::vector<std::uint32_t> order_;   // slots by place, of tiles that were not read yet
  std::vector<std::uint32_t> places_;  // by slot
  std::vector<std::uint32_t> left_;
  std::vector<std::uint32_t> unread_;  // by node, a bit for each tile with boxes to be read
  std::vector<std::uint32_t> nodes_;   // that are being read
  std::size_t read_nodes_ = 0;         // the first ones, which were read once
  std::size_t size_ = 0;
};

}  // namespace broadcl
