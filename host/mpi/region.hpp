#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/broad_phase.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/mpi.hpp>

#include "mpi/messages.hpp"
#include "mpi/ranks.hpp"
#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// The search of a rank: an ordinary broad phase of all objects that touch its region. Slots 0 .. base()-1
/// are for the rank's own objects, by their ids; the following slots are for guests, which are copies of
/// objects of other ranks. Every slot always has an object; unused ones have an empty box.
class Region {
 public:
  Region(const Config& config, std::size_t ranks, Workers& workers);

  /// Empties all slots.
  /// @param base Lower limit for the new base().
  void clear(std::size_t base);
  [[nodiscard]] std::size_t base() const noexcept { return base_; }

  // The rank's own objects.

  /// The packed boxes of all slots, to be written in place until any other function is called.
  [[nodiscard]] std::span<Aabb> map() { return boxes_ = broad_phase_.map_packed(slots_); }
  /// The boxes that map() last returned, at their current address; valid until the search is over, also if
  /// something fails.
  [[nodiscard]] std::span<Aabb> mapped() const noexcept { return boxes_; }
  void move(std::uint32_t slot, const Aabb& box) { broad_phase_.move(slot, box); }
  void set_filter(std::uint32_t slot, const Filter& filter);
  /// Gives a slot to another object, with an empty box.
  void replace(std::uint32_t slot, const Filter& filter);

  // Guests.

  /// @param in By rank; must not change until commit().
  /// @param in_place Whether map() was called for this update.
  void receive(const std::vector<Bytes>& in, bool in_place);
  /// Number of guests.
  [[nodiscard]] std::size_t guests() const noexcept { return guests_.id.size() - free_.size(); }
  [[nodiscard]] MpiId guest_id(std::size_t guest) const noexcept { return guests_.id[guest]; }
  [[nodiscard]] const Aabb& guest_now(std::size_t guest) const noexcept { return guests_.now[guest]; }
  [[nodiscard]] const Aabb& guest_last(std::size_t guest) const noexcept { return guests_.last[guest]; }
  [[nodiscard]] const Filter& guest_filter(std::size_t guest) const noexcept { return guests_.filter[guest]; }
  [[nodiscard]] const Filter& guest_last_filter(std::size_t guest) const noexcept {
    return guests_.last_filter[guest];
  }

  /// Finds what changed in this broad phase, and calls a function while the device searches.
  template <class Function>
  [[nodiscard]] Delta search(const Function& meanwhile) {
    broad_phase_.begin();
    meanwhile();
    Delta delta = broad_phase_.finish();
    pair_count_ += delta.added.size() - delta.removed.size();
    return delta;
  }
  /// Makes the current state that of the last update.
  void commit() noexcept;

  [[nodiscard]] std::vector<Pair> pairs() const { return broad_phase_.pairs(); }
  [[nodiscard]] std::size_t pair_count() const noexcept { return pair_count_; }
  [[nodiscard]] const BroadPhase& broad_phase() const noexcept { return broad_phase_; }

 private:
  void take_leaves(std::size_t rank, std::span<const Leave> leaves);
  void take_enters(std::size_t rank, std::span<const Enter> enters);
  void make_guests();
  void part_free_slots();
  void take_filters();
  void take_boxes(std::span<Aabb> in_place);
  void reserve_slots(bool in_place);
  [[nodiscard]] std::uint32_t slot(std::size_t guest) const noexcept {
    return static_cast<std::uint32_t>(base_ + guest);
  }
  template <class Function>
  void for_each_move(const Function& function, bool in_threads);

  BroadPhase broad_phase_;
  Workers& workers_;
  std::size_t base_ = 0;
  std::size_t slots_ = 0;
  std::span<Aabb> boxes_;
  std::size_t pair_count_ = 0;
  bool any_filters_ = false;

  struct Guests {
    std::vector<MpiId> id;
    std::vector<Aabb> now, last;
    std::vector<Filter> filter, last_filter;
  } guests_;
  std::vector<std::uint32_t> free_;                   // guests that are none
  std::vector<std::vector<std::uint32_t>> guest_of_;  // by rank and by the number of the copy

  // Of the update that is under way.
  std::vector<Tidings> tidings_;  // by rank
  std::vector<std::uint32_t> entered_, left_;
};

}  // namespace broadcl::mpi
