#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/free_lists.hpp"

namespace broadcl {

/// Boxes that were set during an update: of each id, the latest. Only reserve() allocates.
template <class Box>
class LateBoxes {
 public:
  struct Late {
    std::uint32_t id;
    Box box;
  };

  /// Reserves memory for some more boxes. (Not inlined, nor is set(), since a move() calls them seldom.)
  /// @param ids All of theirs are below this one.
  /// @throws std::bad_alloc
  [[gnu::noinline]] void reserve(std::size_t more, std::size_t ids) {
    if (boxes_.capacity() - boxes_.size() < more) boxes_.reserve(2 * boxes_.size() + 16 + more);
    if (indices_.size() < ids) indices_.resize(ids, none);
  }

  [[gnu::noinline]] void set(std::uint32_t id, const Box& box) noexcept {
    if (indices_[id] == none) {
      indices_[id] = static_cast<std::uint32_t>(boxes_.size());
      boxes_.push_back({id, box});
    } else {
      boxes_[indices_[id]].box = box;
    }
  }

  /// Null if the box of this id was not set.
  [[nodiscard]] const Box* find(std::uint32_t id) const noexcept {
    return id < indices_.size() && indices_[id] != none ? &boxes_[indices_[id]].box : nullptr;
  }
  [[nodiscard]] bool empty() const noexcept { return boxes_.empty(); }
  [[nodiscard]] auto begin() const noexcept { return boxes_.begin(); }
  [[nodiscard]] auto end() const noexcept { return boxes_.end(); }

  void clear() noexcept {
    for (const Late& late : boxes_) indices_[late.id] = none;
    boxes_.clear();
  }
  void shrink() noexcept { free_lists(boxes_, indices_); }

 private:
  static constexpr std::uint32_t none = ~std::uint32_t{0};

  std::vector<Late> boxes_;
  std::vector<std::uint32_t> indices_;  // in boxes_, by id
};

}  // namespace broadcl
