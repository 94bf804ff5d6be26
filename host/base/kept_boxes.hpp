#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "base/packed_box.hpp"

namespace broadcl {

/// Boxes on the host, in memory that may outlive this object, and spare ones, which they can be exchanged
/// for. All are packed_empty() at first.
template <class Box>
class KeptBoxes {
 public:
  [[nodiscard]] std::span<Box> get() noexcept { return *boxes_; }
  /// An owner of their memory.
  [[nodiscard]] std::shared_ptr<const void> owner() const noexcept { return boxes_; }

  /// Reserves at least so many boxes. If they move, the spare ones are new ones afterwards.
  /// @throws std::bad_alloc; nothing has changed then.
  void reserve(std::size_t n) {
    if (n <= boxes_->size()) return;
    auto larger = std::make_shared<Boxes>(std::max({n, boxes_->size() * 3 / 2, least}), packed_empty<Box>());
    std::ranges::copy(*boxes_, larger->begin());
    boxes_ = std::move(larger);
    spare_.reset();
  }

  /// As many as boxes.
  /// @throws std::bad_alloc; nothing has changed then.
  [[nodiscard]] std::span<Box> spare() {
    if (spare_ == nullptr) spare_ = std::make_shared<Boxes>(boxes_->size(), packed_empty<Box>());
    return *spare_;
  }
  /// spare() must have been called since the last reserve() and shrink().
  void swap() noexcept { boxes_.swap(spare_); }

  /// Gives back the memory of the spare boxes, and of those from the n-th on.
  /// @throws std::bad_alloc; the boxes are as before then.
  void shrink(std::size_t n) {
    spare_.reset();
    if (n < boxes_->size())
      boxes_ = std::make_shared<Boxes>(boxes_->begin(), boxes_->begin() + static_cast<std::ptrdiff_t>(n));
  }

 private:
  using Boxes = std::vector<Box>;

  static constexpr std::size_t least = 16;  // so that the first boxes do not each allocate

  std::shared_ptr<Boxes> boxes_ = std::make_shared<Boxes>();
  std::shared_ptr<Boxes> spare_;  // null until it is needed
};

}  // namespace broadcl
