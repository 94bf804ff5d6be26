#pragma once

#include <memory>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "kept.hpp"

namespace broadcl {

/// The changes of an update on the host, which a caller may keep beyond the next update.
class ChangeLists {
 public:
  struct Lists {
    std::vector<Pair> added, removed;
  };

  /// The lists for this update: those of an earlier update if nobody keeps them, otherwise new ones.
  /// @throws std::bad_alloc
  [[nodiscard]] Lists& next() {
    if (is_kept(lists_)) std::swap(lists_, others_);
    if (lists_ == nullptr || is_kept(lists_)) lists_ = std::make_shared<Lists>();
    return *lists_;
  }

  /// An owner of the lists of the last update, if there was one.
  [[nodiscard]] std::shared_ptr<const void> owner() const noexcept { return lists_; }

 private:
  std::shared_ptr<Lists> lists_, others_;
};

}  // namespace broadcl
