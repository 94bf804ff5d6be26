#pragma once

#include <cstdint>
#include <cstdio>

/// What differs between operating systems, and only the program uses.
namespace broadcl::cli {

[[nodiscard]] std::uint32_t process_id();

[[nodiscard]] bool is_terminal(std::FILE* stream);

}  // namespace broadcl::cli
