#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

/// What differs between operating systems.
namespace broadcl {

/// The value of an environment variable; none if it is unset or empty.
[[nodiscard]] std::optional<std::string> environment(const char* name);

/// The user's folder for caches ($XDG_CACHE_HOME, otherwise ~/.cache); none if no home is known.
[[nodiscard]] std::optional<std::filesystem::path> user_cache_directory();

struct CloseFile {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// Creates a folder, and those above it, unless they exist. Only the user may use what is created. (On
/// Windows, whoever may use the folder above.)
/// @returns Whether it is a folder of the user or of root in which nobody else may write. (On Windows,
/// whether it is a folder.)
[[nodiscard]] bool make_private_folder(const std::filesystem::path& folder);

/// Creates a file for writing, which only the user may read and write. (On Windows, whoever may use its
/// folder.)
/// @returns Null if that fails, or if there is such a file.
[[nodiscard]] File create_private_file(const std::filesystem::path& path);

/// Opens a file for writing, without a buffer, and empties it. The file may have been there.
/// @returns Null if that fails: then errno is EWOULDBLOCK if another open file is one of this function, in
/// any process. (On Windows, that is like other errors.)
[[nodiscard]] File open_unshared(const std::filesystem::path& path);

[[nodiscard]] std::uint32_t process_id();

/// Has a function called at the beginning of every process that is forked from this one by fork().
/// @returns Whether that is possible, or not needed because there is no fork.
bool call_in_forks(void (*function)()) noexcept;

/// Whether this machine may have a GPU: on Linux, whether there is a device file of one.
/// @param folder Of device files.
[[nodiscard]] bool may_have_gpu(const std::filesystem::path& folder = "/dev");

/// Asks the system for large pages, with which first accesses to new memory take less time. Does nothing for
/// less than 4 MB, and on systems other than Linux.
void use_large_pages(void* begin, std::size_t bytes) noexcept;

/// Returns freed memory of the host to the system, as far as the standard library does not do so by itself.
void give_back_free_memory() noexcept;

}  // namespace broadcl
