#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/thread_pool.hpp"

namespace broadcl {

/// Copies boxes from a view, by several threads if there are many, and finds out which changed. The others
/// begin at once; the thread that has this object takes part in next() and finish().
class BoxReplacement {
 public:
  /// @param view, before, boxes New boxes, those that they replace, and where they are written. They must
  /// outlive this object.
  /// @param streams Whether the processor will not read them while they are in its caches.
  /// @param threads At most; 0 for one per processor.
  /// @throws std::bad_alloc
  BoxReplacement(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes, bool streams,
                 bool samples, std::size_t threads);

  /// Waits for more boxes. To be called until there are all.
  /// @returns How many there are, from the first on: more than before, or all.
  /// @throws InvalidBox for the first box with a NaN bound.
  std::size_t next();
  /// Nobody writes boxes any more.
  void stop() noexcept { loop_.stop(); }
  /// Waits for all boxes.
  /// @throws InvalidBox as above.
  void finish();

  /// Once there are all: how many boxes of the view are not the same as before.
  [[nodiscard]] std::size_t count() const noexcept { return blocks_per_sample_ * count_; }
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

 private:
  static constexpr std::size_t most_pieces = 8;

  void copy(std::size_t part);
  std::size_t compare(std::size_t slot, std::span<const Aabb> block) noexcept;

  const BoxView& view_;
  std::span<const Aabb> before_;
  std::span<Aabb> boxes_;
  bool streams_;
  std::size_t blocks_per_sample_;       // one of so many is compared
  std::vector<std::uint16_t> changed_;  // a bit per box, by block of BoxReader
  std::atomic<std::size_t> count_ = 0;  // of these bits
  std::atomic<bool> any_empty_ = false;
  LowestFound nan_;
  std::size_t parts_per_piece_;
  std::array<std::atomic<std::size_t>, most_pieces> parts_copied_{};  // of each piece
  std::size_t piece_ = 0;                                             // that next() waits for
  ParallelLoop loop_;
};

}  // namespace broadcl
