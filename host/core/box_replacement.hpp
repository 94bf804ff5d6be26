#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Copies boxes from a view, by several threads if there are many, and finds out which changed.
class BoxReplacement {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit BoxReplacement(std::size_t threads) : threads_(threads) {}

  /// Forgets the last replacement, before copy().
  /// @param boxes Of the view.
  /// @throws std::bad_alloc
  void begin(std::size_t boxes);
  /// The same before replace(): also reserves memory for what is replaced.
  /// @param slots Of all objects, before and afterwards.
  /// @throws std::bad_alloc
  void begin_in_place(std::size_t boxes, std::size_t slots);

  /// For boxes most of which change: writes them elsewhere. A sample tells how many change.
  /// @param before The boxes that they replace.
  /// @param meanwhile Called by this thread before it copies.
  /// @param written Called by this thread for consecutive slots that together are all of the view. Null if no
  /// device reads them.
  /// @throws InvalidBox for the first box with a NaN bound; what `written` throws.
  void copy(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes,
            const std::function<void()>& meanwhile, const BoxesWritten& written);

  /// For boxes few of which change: replaces these in place, and lists them.
  /// @throws InvalidBox as above; then some may have been replaced.
  void replace(const BoxView& view, std::span<Aabb> boxes);
  /// Replaces the box of a slot behind those of the view.
  void replace(std::uint32_t slot, const Aabb& packed, std::span<Aabb> boxes) noexcept;
  /// Makes the boxes what they were, if they were replaced in place.
  void undo(std::span<Aabb> boxes) const noexcept;
  /// Calls function(slot) for each box of the view that was replaced in place.
  template <class Function>
  void for_each(const Function& function) const {
    for (std::size_t k = 0; k < counts_.size(); ++k) {
      for (const Replaced& replaced : list(k)) function(replaced.slot);
    }
  }

  /// How many boxes of the view are not the same as before. (Roughly, if they were copied.)
  [[nodiscard]] std::size_t count() const noexcept;
  /// Whether some box of the view is empty.
  [[nodiscard]] bool any_empty() const noexcept { return any_empty_; }

  /// Frees all memory.
  void clear() noexcept { *this = BoxReplacement(threads_); }

 private:
  struct Replaced {
    std::uint32_t slot;
    Aabb before;
  };

  [[nodiscard]] std::span<const Replaced> list(std::size_t of_part) const noexcept {
    return {replaced_.get() + of_part * boxes_per_part, counts_[of_part]};
  }
  template <class Block, class End>
  void for_each_block(const BoxView& view, const std::function<void()>& meanwhile, const Block& block,
                      const End& end);

  std::size_t threads_;
  std::size_t boxes_ = 0;                 // of the view
  std::size_t capacity_ = 0;              // slots
  std::unique_ptr<Replaced[]> replaced_;  // NOLINT(modernize-avoid-c-arrays): by part, from its first slot on
  std::vector<std::size_t> counts_;       // of boxes that changed, by part
  std::size_t beyond_ = 0;                // replaced behind those of the view, listed likewise
  std::size_t sampled_ = 1;               // the counts are of one box of so many
  bool any_empty_ = false;
};

}  // namespace broadcl
