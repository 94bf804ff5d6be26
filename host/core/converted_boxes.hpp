#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>

#include "base/conversion.hpp"
#include "base/coordinate_map.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "core/change_set.hpp"

namespace broadcl {

/// How packed boxes in double precision become those of an algorithm: by a map, which follows boxes into its
/// gaps, and is made anew if too many are there.
class ConvertedBoxes {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit ConvertedBoxes(Threads threads) : threads_(std::move(threads)) {}

  /// Makes the map keep distances from now on. If it did not before, all boxes count as changed afterwards.
  /// @throws std::bad_alloc; nothing has changed then.
  void keep_distances(ChangeSet& changes);

  /// Converts the boxes that changed. Those that have another image, because the map changed, count as
  /// changed afterwards.
  /// @param boxes, out By slot.
  /// @throws std::bad_alloc; `out` is unspecified then, until all count as changed.
  void convert(std::span<const Aabb64> boxes, std::span<Aabb> out, ChangeSet& changes);

  /// For new boxes of all slots, which a BoxReplacement converts, until end(). If the map changes, all count
  /// as changed afterwards.
  /// @param before The present boxes.
  /// @param changes Those that were not converted since they changed.
  /// @param at_once Whether the new ones are used without settle(). Then OutgrownMap is thrown if the map
  /// does not do for them.
  /// @throws std::bad_alloc; all boxes must be converted next.
  [[nodiscard]] Conversion& begin(const BoxView& view, std::span<const Aabb64> before, std::span<Aabb> out,
                                  ChangeSet& changes, bool at_once);
  void end() noexcept;
  /// Changes the map if it does not do for the boxes. Otherwise as convert().
  void settle(std::span<const Aabb64> boxes, std::span<Aabb> out, ChangeSet& changes);
  /// Makes the map anew, for the boxes of a view. All boxes must be converted next.
  /// @throws std::bad_alloc; nothing has changed then.
  void renew(const BoxView& view);

  /// To be called after each update: if many pairs are apart that touch as float32, there may be a better
  /// map.
  void count_apart(std::size_t apart, std::size_t slots) noexcept;

  /// The image of another box.
  [[nodiscard]] Aabb image_of(const Aabb64& box) const noexcept {
    Aabb image;
    (void)map_.convert({&box, 1}, {&image, 1});
    return image;
  }
  [[nodiscard]] const CoordinateMap& map() const noexcept { return map_; }
  /// The axes on which only double precision tells some bounds apart.
  [[nodiscard]] AxisSet in_doubt() const noexcept { return in_doubt_; }

 private:
  [[nodiscard]] CoordinateMap map_for(const BoxView& view) const;
  [[nodiscard]] bool find_better(std::span<const Aabb64> boxes);
  void follow(std::span<const Aabb64> boxes);
  void convert_all(std::span<const Aabb64> boxes, std::span<Aabb> out);
  void convert_one(std::uint32_t slot, std::span<const Aabb64> boxes, std::span<Aabb> out) noexcept;

  Threads threads_;
  bool keeps_distances_ = false;
  CoordinateMap map_;
  std::optional<Conversion> conversion_;  // of all boxes, by the map
  AxisSet in_doubt_ = 0;
  BlockBits away_;  // of the boxes that are away
  std::size_t away_count_ = 0;
  std::size_t outside_ = 0;  // boxes that were found outside since the map followed
  std::size_t updates_ = 0;  // since a better map was looked for
  std::size_t wait_ = 0;     // updates before one is looked for again
  bool is_current_ = false;  // whether all boxes were converted since the map changed
  bool is_crowded_ = false;  // whether many pairs were apart in the last update
};

}  // namespace broadcl
