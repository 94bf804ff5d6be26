#include "mpi/region.hpp"

#include <algorithm>

#include "base/packed_box.hpp"

namespace broadcl::mpi {
namespace {

/// The filter of unused slots for guests: they pair with nothing, and do not prevent the detection of two
/// sets.
constexpr Filter no_pairs{.group = 0, .mask = 0};

constexpr std::size_t moves_per_part = std::size_t{1} << 14U;

}  // namespace

Region::Region(const Config& config, std::size_t ranks, Workers& workers)
    : broad_phase_(config), workers_(workers), guest_of_(ranks) {}

void Region::clear(std::size_t base) {
  (void)broad_phase_.finish();  // there may be one under way
  (void)broad_phase_.map_packed(0);
  (void)broad_phase_.update();
  guests_ = {};
  free_.clear();
  for (std::vector<std::uint32_t>& guests : guest_of_) guests.clear();
  tidings_.clear();
  entered_.clear();
  left_.clear();
  pair_count_ = 0;
  any_filters_ = false;
  // Grow by a share, so that ids that are added one by one do not cause this each time.
  base_ = base_ == 0 || base <= base_ ? std::max(base, base_) : std::max(base, base_ + base_ / 4 + 64);
  slots_ = base_;
  (void)map();
}

void Region::set_filter(std::uint32_t slot, const Filter& filter) {
  if (!any_filters_) {
    if (filter == Filter()) return;
    any_filters_ = true;
    part_free_slots();
  }
  broad_phase_.set_filter(slot, filter);
}

void Region::replace(std::uint32_t slot, const Filter& filter) {
  broad_phase_.remove(slot);
  (void)broad_phase_.add(empty_aabb());  // gets the only id that is free
  set_filter(slot, filter);
}

void Region::receive(const std::vector<Bytes>& in, bool in_place) {
  tidings_.clear();
  for (const Bytes& message : in) tidings_.emplace_back(message);
  for (std::size_t rank = 0; rank < tidings_.size(); ++rank) {
    take_leaves(rank, tidings_[rank].leaves);
    take_enters(rank, tidings_[rank].enters);
  }
  reserve_slots(in_place);
  take_filters();
  take_boxes(in_place ? map() : std::span<Aabb>());
}

void Region::take_leaves(std::size_t rank, std::span<const Leave> leaves) {
  for (const Leave& leave : leaves) {
    const std::uint32_t guest = guest_of_[rank][leave.copy];
    guests_.now[guest] = leave.box;
    guests_.filter[guest] = leave.filter;
    left_.push_back(guest);
  }
}

void Region::take_enters(std::size_t rank, std::span<const Enter> enters) {
  for (const Enter& enter : enters) {
    if (free_.empty()) make_guests();
    const std::uint32_t guest = free_.back();
    free_.pop_back();
    guests_.id[guest] = mpi_id(static_cast<int>(rank), enter.id);
    guests_.now[guest] = enter.box;
    guests_.last[guest] = enter.last;
    guests_.filter[guest] = enter.filter;
    guests_.last_filter[guest] = enter.last_filter;
    std::vector<std::uint32_t>& guest_of = guest_of_[rank];
    if (enter.copy >= guest_of.size()) guest_of.resize(enter.copy + std::size_t{1});
    guest_of[enter.copy] = guest;
    entered_.push_back(guest);
  }
}

/// Makes more slots than are needed, since devices sort again whenever the number of slots changes.
void Region::make_guests() {
  const std::size_t before = guests_.id.size();
  const std::size_t count = before + before / 8 + 64;
  guests_.id.resize(count);
  guests_.now.resize(count);
  guests_.last.resize(count);
  guests_.filter.resize(count);
  guests_.last_filter.resize(count);
  free_.reserve(count);
  for (std::size_t guest = count; guest > before; --guest)
    free_.push_back(static_cast<std::uint32_t>(guest - 1));
}

void Region::reserve_slots(bool in_place) {
  const std::size_t needed = base_ + guests_.id.size();
  if (slots_ == needed) return;
  if (in_place) {
    slots_ = needed;
    (void)map();
  }
  for (; slots_ < needed; ++slots_) (void)broad_phase_.add(empty_aabb());
  if (any_filters_) part_free_slots();
}

void Region::part_free_slots() {
  for (const std::uint32_t guest : free_) broad_phase_.set_filter(slot(guest), no_pairs);
}

void Region::take_filters() {
  if (any_filters_) {
    for (const std::uint32_t guest : left_) broad_phase_.set_filter(slot(guest), no_pairs);
  }
  for (const std::uint32_t guest : entered_) set_filter(slot(guest), guests_.filter[guest]);
  for (std::size_t rank = 0; rank < tidings_.size(); ++rank) {
    for (const Refilter& refilter : tidings_[rank].refilters) {
      const std::uint32_t guest = guest_of_[rank][refilter.copy];
      guests_.filter[guest] = refilter.filter;
      set_filter(slot(guest), refilter.filter);
    }
  }
}

void Region::take_boxes(std::span<Aabb> in_place) {
  const auto set = [&](std::uint32_t guest, const Aabb& box) {
    if (in_place.empty()) {
      broad_phase_.move(slot(guest), box);
    } else {
      in_place[slot(guest)] = pack(box);
    }
  };
  for (const std::uint32_t guest : left_) set(guest, empty_aabb());
  for (const std::uint32_t guest : entered_) set(guest, guests_.now[guest]);
  for_each_move(
      [&](std::uint32_t guest, const Aabb& box) {
        guests_.now[guest] = box;
        set(guest, box);
      },
      !in_place.empty());
}

/// Calls function(guest, box) for each guest that moved.
template <class Function>
void Region::for_each_move(const Function& function, bool in_threads) {
  for (std::size_t rank = 0; rank < tidings_.size(); ++rank) {
    const std::span<const Move> moves = tidings_[rank].moves;
    const std::size_t part = in_threads ? moves_per_part : std::max<std::size_t>(1, moves.size());
    workers_.for_each_part(moves.size(), part, [&](std::size_t begin, std::size_t end) {
      for (const Move& move : moves.subspan(begin, end - begin)) {
        function(guest_of_[rank][move.copy], move.box);
      }
    });
  }
}

void Region::commit() noexcept {
  const auto settle = [&](std::uint32_t guest) {
    guests_.last[guest] = guests_.now[guest];
    guests_.last_filter[guest] = guests_.filter[guest];
  };
  for_each_move([&](std::uint32_t guest, const Aabb& box) { guests_.last[guest] = box; }, true);
  for (std::size_t rank = 0; rank < tidings_.size(); ++rank) {
    for (const Refilter& refilter : tidings_[rank].refilters) settle(guest_of_[rank][refilter.copy]);
  }
  std::ranges::for_each(entered_, settle);
  free_.insert(free_.end(), left_.begin(), left_.end());
  tidings_.clear();
  entered_.clear();
  left_.clear();
}

}  // namespace broadcl::mpi
