#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

/// Everything that differs between operating systems.
namespace broadcl {

/// The value of an environment variable; none if it is unset or empty.
[[nodiscard]] std::optional<std::string> environment(const char* name);

/// The user's folder for caches ($XDG_CACHE_HOME, otherwise ~/.cache); none if no home is known.
[[nodiscard]] std::optional<std::filesystem::path> user_cache_directory();

[[nodiscard]] std::uint32_t process_id();

[[nodiscard]] bool is_terminal(std::FILE* stream);

/// Locks a folder against other callers of this function, in any process, until the returned object is
/// destroyed or the process ends, however it ends.
/// @returns Null if another caller has locked it.
/// @throws Error if the folder cannot be opened or locked.
[[nodiscard]] std::shared_ptr<const void> lock_folder(const std::filesystem::path& folder);

/// Asks the system for large pages, with which first accesses to new memory take less time. Does nothing on
/// systems other than Linux.
void use_large_pages(void* begin, std::size_t bytes) noexcept;

/// The name of the processor, as people know it; the architecture if the system reports no more.
[[nodiscard]] std::string processor_name();

/// The operating system and its version.
[[nodiscard]] std::string system_name();

}  // namespace broadcl
