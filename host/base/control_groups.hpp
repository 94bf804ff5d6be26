#pragma once

#include <cstddef>
#include <string>

namespace broadcl {

/// For how many processors the control groups of this process give it time (Linux, both versions), rounded
/// up: the least limit of its own group and of those above; the largest number if there is none.
/// @param root Precedes the names of all files.
/// @throws std::bad_alloc, std::ios_base::failure
[[nodiscard]] std::size_t control_group_processors(const std::string& root = {});

}  // namespace broadcl
