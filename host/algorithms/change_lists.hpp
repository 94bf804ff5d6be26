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
    are_others_next_ = is_kept(lists_);
    std::shared_ptr<Lists>& next = are_others_next_ ? others_ : lists_;
    if (next == nullptr || is_kept(next)) next = std::make_shared<Lists>();
    return *next;
  }

  /// The update succeeded.
  void commit() noexcept {
    if (std::exchange(are_others_next_, false)) lists_.swap(others_);
  }

  /// An owner of the lists of the last update, if there was one.
  [[nodiscard]] std::shared_ptr<const void> owner() const noexcept { return lists_; }

 private:
  std::shared_ptr<Lists> lists_, others_;
  bool are_others_next_ = false;
};

}  // namespace broadcl
