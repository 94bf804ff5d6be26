#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <span>

#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "base/conversion.hpp"
#include "base/non_copyable.hpp"
#include "base/thread_pool.hpp"

namespace broadcl {

/// Boxes that are still being written, by other threads, and by that which waits for them.
class ArrivingBoxes : NonCopyable {
 public:
  virtual ~ArrivingBoxes() = default;

  /// Waits for more boxes. To be called until there are all.
  /// @returns How many there are, from the first on: more than before, or all.
  /// @throws As BoxReplacement::finish().
  virtual std::size_t next() = 0;
  /// Nobody writes boxes any more.
  virtual void stop() noexcept = 0;
};

/// Copies boxes from a view, by several threads if there are many, and finds out which changed, or only finds
/// that out. The others begin at once; the thread that has this object takes part in next() and finish().
template <class Box>
class BoxReplacement final : public ArrivingBoxes {
 public:
  /// @param view, before New boxes, and those that they replace. Both must outlive this object.
  /// @param boxes Where they are written, which must outlive it, too; none if they are only compared, until
  /// it is known whether many changed.
  /// @param streams Whether the processor will not read them while they are in its caches.
  /// @param samples Whether only some are compared.
  /// @param threads At most; 0 for one per processor.
  /// @param conversion To float32, which is done, too; not for an Aabb. Must outlive this object.
  /// @throws std::bad_alloc
  BoxReplacement(const BoxView& view, std::span<const Box> before, std::span<Box> boxes, bool streams,
                 bool samples, const Threads& threads, Conversion* conversion = nullptr);

  std::size_t next() override;
  void stop() noexcept override { loop_.stop(); }
  /// Waits for all boxes.
  /// @throws InvalidBox for the first box with a NaN bound, unless boxes are only compared and many changed;
  /// OutgrownMap as Conversion::finish() does.
  void finish();

  /// Once there are all: how many boxes of the view are not the same as before, and whether they are so many
  /// that it is less work to take all for changed.
  [[nodiscard]] std::size_t count() const noexcept { return blocks_per_sample_ * count_; }
  [[nodiscard]] bool are_many() const noexcept { return count() > view_.size() / 4; }
  /// Calls function(slot) for each of these.
  template <class Function>
  void for_each_changed(const Function& function) const {
    for_each_bit(changed_, function);
  }
  /// Whether some box of the view is empty.
  [[nodiscard]] bool any_empty() const noexcept { return any_empty_; }

 private:
  static constexpr std::size_t most_pieces = 8;

  /// Whether nothing is left to find out.
  [[nodiscard]] bool is_decided() const noexcept { return boxes_.empty() && are_many(); }
  void copy(std::size_t part);
  std::size_t compare(std::size_t slot, std::span<const Box> block) noexcept;
  template <class Some>
  void write(std::span<const Some> block, Some* to) const noexcept;

  const BoxView& view_;
  std::span<const Box> before_;
  std::span<Box> boxes_;
  bool streams_;
  std::size_t blocks_per_sample_;  // one of so many is compared
  BlockBits changed_;
  std::atomic<std::size_t> count_ = 0;  // of these bits
  std::atomic<bool> any_empty_ = false;
  LowestFound nan_;
  Conversion* conversion_;
  std::size_t parts_per_piece_;
  std::array<std::atomic<std::size_t>, most_pieces> parts_copied_{};  // of each piece
  std::size_t piece_ = 0;                                             // that next() waits for
  ParallelLoop loop_;
};

}  // namespace broadcl
