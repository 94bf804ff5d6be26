#pragma once

#include <memory>
#include <utility>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/kept.hpp"

namespace broadcl {

/// The changes of an update on the host, which a caller may keep beyond the next update.
class ChangeLists {
 public:
  /// Calls a function that writes the lists for this update: those of an earlier update if nobody keeps them,
  /// otherwise new ones.
  /// @param write Is given the added and the removed pairs. If it throws, the lists are freed.
  template <class Function>
  Delta fill(const Function& write) {
    are_others_next_ = is_kept(lists_);
    std::shared_ptr<Lists>& next = are_others_next_ ? others_ : lists_;
    if (next == nullptr || is_kept(next)) next = std::make_shared<Lists>();
    try {
      write(next->added, next->removed);
    } catch (...) {
      next.reset();
      are_others_next_ = false;
      throw;
    }
    return {next->added, next->removed, next};
  }

  /// The update succeeded.
  void commit() noexcept {
    if (std::exchange(are_others_next_, false)) lists_.swap(others_);
  }

  /// Frees the lists, except those that somebody keeps.
  void clear() noexcept { *this = {}; }

 private:
  struct Lists {
    std::vector<Pair> added, removed;
  };

  std::shared_ptr<Lists> lists_, others_;
  bool are_others_next_ = false;
};

}  // namespace broadcl
