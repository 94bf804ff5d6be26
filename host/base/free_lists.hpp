#pragma once

#include <vector>

namespace broadcl {

/// Empties lists and frees their memory. (An assignment of {} would keep it.)
template <class... T>
void free_lists(std::vector<T>&... lists) noexcept {
  ((lists = std::vector<T>()), ...);
}

}  // namespace broadcl
