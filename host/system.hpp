#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>

/// All that differs between operating systems.
namespace broadcl {

/// The value of an environment variable; none where it is unset or empty.
[[nodiscard]] std::optional<std::string> environment(const char* name);

/// The user's folder for caches ($XDG_CACHE_HOME, else ~/.cache); none where no home is known.
[[nodiscard]] std::optional<std::filesystem::path> user_cache_directory();

[[nodiscard]] std::uint32_t process_id();

[[nodiscard]] bool is_terminal(std::FILE* stream);

/// The name of the processor, as people know it; the architecture where the system does not tell more.
[[nodiscard]] std::string processor_name();

/// The operating system and its version.
[[nodiscard]] std::string system_name();

}  // namespace broadcl
