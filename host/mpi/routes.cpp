#include "mpi/routes.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <string>

#include <broadcl/error.hpp>

#include "base/packed_box.hpp"
#include "base/prefetch.hpp"

namespace broadcl::mpi {
namespace {

constexpr std::size_t objects_per_part = std::size_t{1} << 14U;
/// So few that their boxes stay in the processor's cache.
constexpr std::size_t objects_per_block = 1024;

/// Bytes to copy into a message.
struct Piece {
  std::byte* to;
  const void* from;
  std::size_t bytes;
};

template <class Value>
void append(const std::vector<Value>& values, std::byte*& end, std::vector<Piece>& pieces) {
  if (values.empty()) return;
  pieces.push_back({end, values.data(), values.size() * sizeof(Value)});
  end += values.size() * sizeof(Value);
}

}  // namespace

void Routes::Part::clear() noexcept {
  for (std::vector<Move>& list : moves) list.clear();
  for (std::vector<Refilter>& list : refilters) list.clear();
  rerouted.clear();
  altered.clear();
  here_count = 0;
  nan.reset();
  failure = nullptr;
}

Routes::Routes(std::size_t rank, std::size_t ranks, Workers& workers)
    : rank_(rank), workers_(workers), numbers_(ranks), enters_(ranks), leaves_(ranks) {}

void Routes::clear() noexcept {
  std::ranges::fill(where_, std::uint8_t{0});
  std::ranges::fill(next_, std::uint8_t{0});
  std::ranges::fill(first_copy_, none);
  copies_.clear();
  free_copies_.clear();
  for (Numbers& numbers : numbers_) {
    numbers.count = 0;
    numbers.free.clear();
  }
  here_count_ = 0;
}

bool Routes::route(Objects& objects, const Cuts& cuts, To to, bool all, Region& region,
                   std::vector<Bytes>& out) {
  const std::size_t ids = objects.ids();
  where_.resize(ids, 0);
  next_.resize(ids, 0);
  first_copy_.resize(ids, none);
  for (std::vector<Enter>& list : enters_) list.clear();
  for (std::vector<Leave>& list : leaves_) list.clear();

  const ChangeSet& changes = objects.changes();
  const bool is_all_routed = all || changes.all || to == To::last;
  const std::size_t count = is_all_routed ? ids : changes.changed().size();
  const bool is_in_place = is_all_routed || count > ids / 8;
  Journey journey{.objects = objects,
                  .cuts = cuts,
                  .own = cuts.bounds(rank_),
                  .to = to,
                  .all = is_all_routed,
                  .boxes = to == To::now ? objects.now() : objects.last(),
                  .in_place = {}};
  filter_own(journey, region);
  end_replaced(journey, region);
  if (is_in_place) journey.in_place = region.map();

  const std::size_t parts =
      is_in_place ? std::clamp<std::size_t>(count / objects_per_part, 1, 4 * workers_.threads()) : 1;
  if (parts > parts_.size()) {
    parts_.resize(parts, Part{.moves = std::vector<std::vector<Move>>(numbers_.size()),
                              .refilters = std::vector<std::vector<Refilter>>(numbers_.size()),
                              .rerouted = {},
                              .altered = {},
                              .touched = {},
                              .leaving = std::vector<std::uint32_t>(objects_per_block),
                              .here_count = 0,
                              .nan = {},
                              .failure = {}});
  }
  for (Part& part : parts_) part.clear();
  workers_.for_each(parts, [&](std::size_t k) {
    route_part(journey, count * k / parts, count * (k + 1) / parts, region, parts_[k]);
  });
  if (is_in_place) objects.packed();
  for (Part& part : parts_) {
    if (part.failure != nullptr) std::rethrow_exception(part.failure);
    if (part.nan) throw_nan("box " + std::to_string(*part.nan));
    here_count_ = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(here_count_) + part.here_count);
    for (const std::uint32_t id : part.rerouted) reroute(journey, id, part);
  }
  write(out);
  return is_in_place;
}

Filter Routes::filter(const Journey& journey, std::uint32_t id) const noexcept {
  return journey.to == To::now ? journey.objects.filter(id) : journey.objects.last_filter(id);
}

/// Sets the filters of this rank's own objects in the region.
void Routes::filter_own(const Journey& journey, Region& region) {
  const Objects& objects = journey.objects;
  if (!objects.any_filters()) return;
  if (journey.to == To::last) {
    for (std::uint32_t id = 0; id < objects.ids(); ++id) region.set_filter(id, objects.last_filter(id));
  } else if (objects.changes().filters) {
    for (const std::uint32_t id : objects.changes().changed()) region.set_filter(id, objects.filter(id));
  }
}

/// Makes objects whose id now belongs to another object, or to none, leave all regions.
void Routes::end_replaced(const Journey& journey, Region& region) {
  if (journey.to == To::last) return;
  for (const std::uint32_t id : journey.objects.changes().recycled()) {
    next_[id] |= another;
    if ((where_[id] & here) != 0) region.replace(id, journey.objects.filter(id));
    for (std::uint32_t k = first_copy_[id]; k != none; k = copies_[k].next) {
      leave(copies_[k], empty_aabb(), journey.objects.filter(id));
      free_copies_.push_back(k);
    }
    first_copy_[id] = none;
  }
}

void Routes::route_part(const Journey& journey, std::size_t begin, std::size_t end, Region& region,
                        Part& part) {
  if (!journey.all) {
    for (const std::uint32_t id : journey.objects.changes().changed().subspan(begin, end - begin)) {
      route_one(journey, id, region, part);
    }
    return;
  }
  for (std::size_t block = begin; block < end; block += objects_per_block) {
    const std::size_t count = std::min(objects_per_block, end - block);
    const std::span<Aabb> boxes = journey.in_place.subspan(block, count);
    if (!journey.objects.are_lent()) std::ranges::copy(journey.boxes.subspan(block, count), boxes.begin());
    std::size_t leaving = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const auto id = static_cast<std::uint32_t>(block + k);
      part.leaving[leaving] = id;
      leaving += next_[id] == here && is_proper(boxes[k]) && journey.own.enclose(boxes[k]) ? 0U : 1U;
    }
    route_leaving(journey, std::span(part.leaving).first(leaving), region, part);
  }
}

/// Routes objects that may be in other regions.
void Routes::route_leaving(const Journey& journey, std::span<const std::uint32_t> leaving, Region& region,
                           Part& part) {
  for (const std::uint32_t id : leaving) {
    prefetch(&first_copy_[id]);
    prefetch(&journey.objects.last()[id]);
    prefetch(&journey.boxes[id]);
  }
  for (const std::uint32_t id : leaving) {
    if (first_copy_[id] != none) prefetch(&copies_[first_copy_[id]]);
    if (journey.objects.are_lent()) journey.objects.keep(id, journey.in_place[id]);
  }
  if (part.failure != nullptr) return;
  try {
    for (const std::uint32_t id : leaving) route_one(journey, id, region, part);
  } catch (...) {  // others must be kept
    part.failure = std::current_exception();
  }
}

void Routes::route_one(const Journey& journey, std::uint32_t id, Region& region, Part& part) {
  const Aabb& box = journey.boxes[id];
  part.touched.clear();
  bool is_here = false;
  if (is_proper(box)) {
    is_here = journey.own.enclose(box) || touch(journey, box, part.touched);
  } else if (has_nan(box)) {
    if (!part.nan) part.nan = id;
    return;
  }
  if (journey.in_place.empty()) {
    region.move(id, is_here ? box : empty_aabb());
  } else {
    journey.in_place[id] = is_here ? box : packed_empty();
  }
  std::uint8_t& next = next_[id];
  part.here_count += (is_here ? 1 : 0) - (next & here);
  next = static_cast<std::uint8_t>((next & another) | (is_here ? here : 0) |
                                   (part.touched.empty() ? 0 : elsewhere));
  if (next != where_[id]) part.altered.push_back(id);

  std::uint32_t copy = first_copy_[id];
  for (const std::uint32_t rank : part.touched) {
    if (copy == none || copies_[copy].rank != rank) {
      part.rerouted.push_back(id);
      return;
    }
    copy = copies_[copy].next;
  }
  if (copy != none) {
    part.rerouted.push_back(id);
    return;
  }
  for (copy = first_copy_[id]; copy != none; copy = copies_[copy].next) {
    keep_up(journey, id, copies_[copy], part);
  }
}

/// Lists the regions that a box touches, except this rank's region, and returns whether it touches that one.
bool Routes::touch(const Journey& journey, const Aabb& box, std::vector<std::uint32_t>& others) const {
  bool is_here = false;
  journey.cuts.for_each_touched(box, [&](std::size_t region) {
    if (region == rank_) {
      is_here = true;
    } else {
      others.push_back(static_cast<std::uint32_t>(region));
    }
  });
  return is_here;
}

/// Updates a copy that stays.
void Routes::keep_up(const Journey& journey, std::uint32_t id, const Copy& copy, Part& part) const {
  const Aabb& box = journey.boxes[id];
  if (!same_bits(box, journey.objects.last()[id])) {
    part.moves[copy.rank].push_back({.copy = copy.number, .box = box});
  }
  const Objects& objects = journey.objects;
  if (objects.changes().filters && objects.filter(id) != objects.last_filter(id)) {
    part.refilters[copy.rank].push_back({.copy = copy.number, .filter = objects.filter(id)});
  }
}

/// Creates and removes copies of an object.
void Routes::reroute(const Journey& journey, std::uint32_t id, Part& part) {
  const Aabb& box = journey.boxes[id];
  part.touched.clear();
  if (is_proper(box)) (void)touch(journey, box, part.touched);

  std::uint32_t old = first_copy_[id];
  std::uint32_t previous = none;
  const auto append = [&](std::uint32_t copy) {
    (previous == none ? first_copy_[id] : copies_[previous].next) = copy;
    previous = copy;
  };
  const auto end_old = [&] {
    leave(copies_[old], box, filter(journey, id));
    free_copies_.push_back(old);
    old = copies_[old].next;
  };
  for (const std::uint32_t rank : part.touched) {
    while (old != none && copies_[old].rank < rank) end_old();
    if (old != none && copies_[old].rank == rank) {
      keep_up(journey, id, copies_[old], part);
      const std::uint32_t kept = old;
      old = copies_[old].next;
      append(kept);
    } else {
      append(enter(journey, id, rank));
    }
  }
  while (old != none) end_old();
  append(none);
}

void Routes::leave(const Copy& copy, const Aabb& box, const Filter& filter) {
  leaves_[copy.rank].push_back({.copy = copy.number, .box = box, .filter = filter});
  numbers_[copy.rank].free.push_back(copy.number);
}

std::uint32_t Routes::enter(const Journey& journey, std::uint32_t id, std::uint32_t rank) {
  Numbers& numbers = numbers_[rank];
  std::uint32_t number = numbers.count;
  if (numbers.free.empty()) {
    ++numbers.count;
  } else {
    number = numbers.free.back();
    numbers.free.pop_back();
  }
  const bool is_new = journey.to == To::last || is_another(id);
  enters_[rank].push_back({.copy = number,
                           .id = id,
                           .box = journey.boxes[id],
                           .last = is_new ? empty_aabb() : journey.objects.last()[id],
                           .filter = filter(journey, id),
                           .last_filter = journey.objects.last_filter(id)});
  auto copy = static_cast<std::uint32_t>(copies_.size());
  if (free_copies_.empty()) {
    copies_.emplace_back();
  } else {
    copy = free_copies_.back();
    free_copies_.pop_back();
  }
  copies_[copy] = {.rank = rank, .number = number, .next = none};
  return copy;
}

void Routes::write(std::vector<Bytes>& out) {
  const std::size_t ranks = numbers_.size();
  out.resize(ranks);
  std::vector<Piece> pieces;
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    Counts<4> counts{{0, enters_[rank].size(), leaves_[rank].size(), 0}};
    for (const Part& part : parts_) {
      counts.of[0] += part.moves[rank].size();
      counts.of[3] += part.refilters[rank].size();
    }
    const auto& [moves, enters, leaves, refilters] = counts.of;
    if (moves + enters + leaves + refilters == 0) {
      out[rank].resize(0);
      continue;
    }
    out[rank].resize(sizeof(counts) + moves * sizeof(Move) + enters * sizeof(Enter) + leaves * sizeof(Leave) +
                     refilters * sizeof(Refilter));
    std::byte* end = out[rank].data();
    std::memcpy(end, &counts, sizeof(counts));
    end += sizeof(counts);
    for (const Part& part : parts_) append(part.moves[rank], end, pieces);
    append(enters_[rank], end, pieces);
    append(leaves_[rank], end, pieces);
    for (const Part& part : parts_) append(part.refilters[rank], end, pieces);
  }
  const auto copy = [&](std::size_t k) { std::memcpy(pieces[k].to, pieces[k].from, pieces[k].bytes); };
  if (pieces.size() > 2 * ranks) {
    workers_.for_each(pieces.size(), copy);
  } else {
    for (std::size_t k = 0; k < pieces.size(); ++k) copy(k);
  }
}

void Routes::write_absent(std::span<const Aabb> boxes, std::span<Aabb> to) {
  workers_.for_each_part(boxes.size(), objects_per_part, [&](std::size_t begin, std::size_t end) {
    std::array<std::size_t, objects_per_block> absent;  // NOLINT(*-member-init): written first
    for (std::size_t block = begin; block < end; block += objects_per_block) {
      std::size_t count = 0;
      for (std::size_t id = block; id < std::min(end, block + objects_per_block); ++id) {
        absent[count] = id;
        count += (where_[id] & here) == 0 ? 1U : 0U;
      }
      const auto ids = std::span(absent).first(count);
      for (const std::size_t id : ids) {
        prefetch(&boxes[id]);
        prefetch(&to[id]);
      }
      for (const std::size_t id : ids) to[id] = boxes[id];
    }
  });
}

void Routes::commit() noexcept {
  for (const Part& part : parts_) {
    for (const std::uint32_t id : part.altered) {
      next_[id] = static_cast<std::uint8_t>(next_[id] & ~another);
      where_[id] = next_[id];
    }
  }
}

}  // namespace broadcl::mpi
