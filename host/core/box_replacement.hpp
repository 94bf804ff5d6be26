#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>

#include "base/box_reader.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Copies boxes from a view, by several threads if there are many, and finds out which changed.
class BoxReplacement {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit BoxReplacement(std::size_t threads) : threads_(threads) {}

  /// Forgets the last replacement.
  /// @param boxes Of the view.
  /// @throws std::bad_alloc
  void begin(std::size_t boxes);

  /// Writes the boxes elsewhere than those that they replace.
  /// @param before The boxes that they replace.
  /// @param meanwhile Called by this thread before it copies.
  /// @param written Called by this thread for consecutive slots that together are all of the view. Null if no
  /// device reads them.
  /// @throws InvalidBox for the first box with a NaN bound; what `written` throws.
  void copy(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes,
            const std::function<void()>& meanwhile, const BoxesWritten& written);

  /// How many boxes of the view are not the same as before.
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  /// Calls function(slot) for each of these.
  template <class Function>
  void for_each_changed(const Function& function) const {
    for (std::size_t block = 0; block < changed_.size(); ++block) {
      for (unsigned rest = changed_[block]; rest != 0; rest &= rest - 1) {
        function(static_cast<std::uint32_t>(block * BoxReader::block) +
                 static_cast<std::uint32_t>(std::countr_zero(rest)));
      }
    }
  }
  /// Whether some box of the view is empty.
  [[nodiscard]] bool any_empty() const noexcept { return any_empty_; }

  /// Frees all memory.
  void clear() noexcept { *this = BoxReplacement(threads_); }

 private:
  std::size_t compare(std::size_t slot, std::span<const Aabb> before, std::span<const Aabb> block) noexcept;

  std::size_t threads_;
  std::size_t boxes_ = 0;               // of the view
  std::vector<std::uint16_t> changed_;  // a bit per box, by block of BoxReader
  std::size_t count_ = 0;               // of these bits
  bool any_empty_ = false;
};

}  // namespace broadcl
