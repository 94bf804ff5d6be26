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
/// Windows, whoever may use the folder above.) Failures show when a file is created there.
void create_private_folder(const std::filesystem::path& folder);

struct NewFile {
  std::filesystem::path path;
  File stream;  ///< Null if no file could be created.
};

/// Creates a file for writing, under a name that cannot be guessed and that nothing had before, so no link is
/// followed. Only the user may read and write it.
[[nodiscard]] NewFile create_private_file(const std::filesystem::path& folder);

struct OwnFile {
  File stream;  ///< Null if there is no such file, or if it cannot be read.
  std::uint64_t size = 0;
};

/// Opens a file for reading, if it is a regular file, not a link, that belongs to the user or to root, and
/// that nobody else may write. (On Windows, any regular file.) Never waits.
[[nodiscard]] OwnFile open_own_file(const std::filesystem::path& path);

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
