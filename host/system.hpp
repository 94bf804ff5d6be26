#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
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

/// Keeps a folder from others who take it by this means, in any process, until what is returned or the
/// process comes to its end, whichever way.
/// @returns Null where somebody else has it.
/// @throws Error where the folder cannot be opened or locked.
[[nodiscard]] std::shared_ptr<const void> lock_folder(const std::filesystem::path& folder);

/// The name of the processor, as people know it; the architecture where the system does not tell more.
[[nodiscard]] std::string processor_name();

/// The operating system and its version.
[[nodiscard]] std::string system_name();

}  // namespace broadcl
