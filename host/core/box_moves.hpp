#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "core/object_table.hpp"

namespace broadcl {

/// New boxes of some objects, which several threads check and store if there are many. (They store only if
/// the ids ascend, so that none is there twice.) If an id is given twice, it gets the later box.
template <class Box>
class BoxMoves {
 public:
  /// @param ids, boxes As many of both; they must outlive this object.
  /// @param threads At most; 0 for one per processor.
  /// @throws Error for an unknown id, and for the first box with a NaN bound; std::bad_alloc.
  BoxMoves(std::span<const std::uint32_t> ids, const BoxView& boxes,
           const ObjectTable<BoundType<Box>>& objects, Threads threads);

  [[nodiscard]] bool any_empty() const noexcept { return any_empty_; }

  /// Calls function(id, box) for each; boxes are packed.
  template <class Function>
  void for_each(const Function& function) const {
    for_each(0, ids_.size(), function);
  }

  /// Stores the boxes.
  void store(std::span<Box> boxes) noexcept;
  /// Of the ids whose boxes are others now, each at least once.
  [[nodiscard]] std::size_t changed_count() const noexcept;
  template <class Function>
  void for_each_changed(const Function& function) const {
    for (std::size_t k = 0; k < counts_.size(); ++k) {
      for (std::size_t i = 0; i < counts_[k]; ++i) function(changed_[k * boxes_per_part + i]);
    }
  }

 private:
  template <class Function>
  void for_each(std::size_t begin, std::size_t end, const Function& function) const {
    BoxReader<Box>(boxes_).for_each(begin, end,
                                    [&](std::size_t k, const Box& box) { function(ids_[k], pack(box)); });
  }

  std::span<const std::uint32_t> ids_;
  const BoxView& boxes_;
  Threads threads_;
  bool any_empty_ = false;
  // By part, from its first box on: ids that changed.
  std::unique_ptr<std::uint32_t[]> changed_;  // NOLINT(modernize-avoid-c-arrays): not initialised
  std::vector<std::size_t> counts_;
};

}  // namespace broadcl
