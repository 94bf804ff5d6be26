#pragma once

#include <memory>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "kept.hpp"

namespace broadcl {

/// The changes of an update on the host, which a caller may keep for longer than until the next one.
class ChangeLists {
 public:
  struct Lists {
    std::vector<Pair> added, removed;
  };

  /// The lists for this update: those of an earlier one that nobody keeps, otherwise new ones.
  /// @throws std::bad_alloc
  [[nodiscard]] Lists& next() {
    if (is_kept(lists_)) std::swap(lists_, others_);
    if (lists_ == nullptr || is_kept(lists_)) lists_ = std::make_shared<Lists>();
    return *lists_;
  }

  /// Keeps those of the last update, if there was one.
  [[nodiscard]] std::shared_ptr<const void> owner() const noexcept { return lists_; }

 private:
  std::shared_ptr<Lists> lists_, others_;
};

}  // namespace broadcl
