#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

/// What differs between operating systems, and only the program uses.
namespace broadcl::cli {

[[nodiscard]] std::uint32_t process_id();

[[nodiscard]] bool is_terminal(std::FILE* stream);

/// Locks a folder against other callers of this function, in any process, until the returned object is
/// destroyed or the process ends, however it ends.
/// @returns Null if another caller has locked it.
/// @throws Error if the folder cannot be opened or locked.
[[nodiscard]] std::shared_ptr<const void> lock_folder(const std::filesystem::path& folder);

/// The name of the processor, as people know it; the architecture if the system reports no more.
[[nodiscard]] std::string processor_name();

/// The operating system and its version.
[[nodiscard]] std::string system_name();

}  // namespace broadcl::cli
