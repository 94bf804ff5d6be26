#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

/// What differs between operating systems, and only the program uses.
namespace broadcl::cli {

[[nodiscard]] std::uint32_t process_id();

[[nodiscard]] bool is_terminal(std::FILE* stream);

/// Name, release and processor of the system: "Linux 6.1.0-32-amd64 x86_64". (On Windows, only its name.)
[[nodiscard]] std::string operating_system();

}  // namespace broadcl::cli
