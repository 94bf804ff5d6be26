#include "core/converted_boxes.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"

namespace broadcl {
namespace {

/// How many boxes may be where the map does not tell them apart from others nearby: so few that their pairs
/// are fewer than boxes.
std::size_t most_outside(std::size_t slots) {
  return 32 + static_cast<std::size_t>(std::sqrt(static_cast<double>(slots) / 2));
}

/// How many may be in gaps of the map, where there is less room.
std::size_t most_away(std::size_t slots) {
  return 64 + slots / 16;
}

}  // namespace

void ConvertedBoxes::convert(std::span<const Aabb64> boxes, std::span<Aabb> out, ChangeSet& changes) {
  if (find_better(boxes)) changes.all = true;
  const std::span<const std::uint32_t> changed = changes.changed();
  if (!map_.is_made()) {
    // settle() makes one, and converts all.
  } else if (changes.all || changed.size() > boxes.size() / 4) {
    convert_all(boxes, out);
  } else {
    away_.resize(blocks_of(boxes.size()));
    for (const std::uint32_t slot : changed) convert_one(slot, boxes, out);
  }
  settle(boxes, out, changes);
}

Conversion& ConvertedBoxes::begin(const BoxView& view, std::span<const Aabb64> before, std::span<Aabb> out,
                                  ChangeSet& changes, bool at_once) {
  const std::size_t n = view.size();
  (void)find_better(before);
  if (outside_ > 0 && changes.empty()) follow(before);
  if (!map_.is_made()) renew(view);
  changes.all = changes.all || !is_current_;
  if (at_once) return conversion_.emplace(map_, out, n, most_outside(n), most_away(n));
  return conversion_.emplace(map_, out, n);
}

void ConvertedBoxes::end() noexcept {
  away_.swap(conversion_->away());
  away_count_ = conversion_->away_count();
  outside_ = conversion_->outside_count();
  in_doubt_ = conversion_->in_doubt();
  is_current_ = true;
  conversion_.reset();
}

void ConvertedBoxes::settle(std::span<const Aabb64> boxes, std::span<Aabb> out, ChangeSet& changes) {
  if (map_.is_made() && outside_ > 0) {
    follow(boxes);
    for_each_bit(away_, [&](std::uint32_t slot) {
      convert_one(slot, boxes, out);
      changes.insert(slot);
    });
    is_current_ = true;
  }
  if (!map_.is_made() || outside_ > most_outside(boxes.size()) || away_count_ > most_away(boxes.size())) {
    changes.all = true;  // even if a part of the following fails
    renew(boxes);
    convert_all(boxes, out);
  }
  outside_ = 0;
}

void ConvertedBoxes::keep_distances(ChangeSet& changes) {
  if (keeps_distances_) return;
  map_ = CoordinateMap();
  changes.all = true;
  keeps_distances_ = true;
  is_current_ = false;
}

CoordinateMap ConvertedBoxes::map_for(const BoxView& view) const {
  return {view.size(),
          [&](std::size_t first, std::span<Aabb64> out) {
            BoxReader<Aabb64>(view).for_each(
                first, first + out.size(),
                [&](std::size_t k, const Aabb64& box) { out[k - first] = pack(box); });
          },
          keeps_distances_, threads_};
}

void ConvertedBoxes::renew(const BoxView& view) {
  map_ = map_for(view);
  is_current_ = false;
}

void ConvertedBoxes::count_apart(std::size_t apart, std::size_t slots) noexcept {
  is_crowded_ = apart > 64 + slots / 8;
  ++updates_;
}

/// Makes the map anew if that makes a difference. Then all boxes must be converted next.
bool ConvertedBoxes::find_better(std::span<const Aabb64> boxes) {
  if (!is_crowded_ || updates_ < wait_) return false;
  CoordinateMap other = map_for(boxes);
  constexpr std::size_t least_wait = 16;
  const bool is_better = other.halves(map_);
  wait_ = is_better ? least_wait : std::max(least_wait, 2 * wait_);
  updates_ = 0;
  if (!is_better) return false;
  map_ = std::move(other);
  is_current_ = false;
  return true;
}

/// Moves the map's windows to the boxes that are away, which must be converted next.
void ConvertedBoxes::follow(std::span<const Aabb64> boxes) {
  std::vector<Aabb64> some;
  for_each_bit(away_, [&](std::uint32_t slot) { some.push_back(boxes[slot]); });
  map_.follow(some);
  is_current_ = false;
  outside_ = 0;
}

void ConvertedBoxes::convert_all(std::span<const Aabb64> boxes, std::span<Aabb> out) {
  conversion_.emplace(map_, out, boxes.size());
  for_each_part(boxes.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    for (std::size_t first = begin; first < end; first += boxes_per_block) {
      const std::size_t count = std::min(boxes_per_block, end - first);
      conversion_->convert(first, boxes.subspan(first, count), out.subspan(first, count));
    }
  });
  end();
}

void ConvertedBoxes::convert_one(std::uint32_t slot, std::span<const Aabb64> boxes,
                                 std::span<Aabb> out) noexcept {
  const unsigned found = map_.convert(boxes.subspan(slot, 1), out.subspan(slot, 1));
  in_doubt_ |= found & CoordinateMap::in_doubt;
  if ((found & CoordinateMap::outside) != 0) ++outside_;
  std::uint16_t& block = away_[slot / boxes_per_block];
  const auto bit = static_cast<std::uint16_t>(1U << slot % boxes_per_block);
  if (((block & bit) != 0) != ((found & CoordinateMap::away) != 0)) {
    block ^= bit;
    (block & bit) != 0 ? ++away_count_ : --away_count_;
  }
}

}  // namespace broadcl
