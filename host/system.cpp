#include "system.hpp"

#include <cerrno>
#include <cstdlib>
#include <system_error>
#include <utility>

#include <broadcl/error.hpp>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <process.h>
#include <share.h>
#include <sys/stat.h>

#include <random>
#else
#include <fcntl.h>
#include <pthread.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <fstream>
#include <string_view>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#endif

namespace broadcl {

std::optional<std::string> environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  if (value == nullptr || *value == '\0') return std::nullopt;
  return value;
}

namespace {

[[noreturn]] void fail_to_lock(const std::filesystem::path& folder, int error) {
  throw Error("cannot lock the folder '" + folder.string() + "': " + std::generic_category().message(error));
}

}  // namespace

#ifdef _WIN32

void create_private_folder(const std::filesystem::path& folder) {
  std::error_code ignored;
  std::filesystem::create_directories(folder, ignored);
}

NewFile create_private_file(const std::filesystem::path& folder) {
  std::random_device random;
  const std::filesystem::path path =
      folder / ("new-" + std::to_string(random()) + "-" + std::to_string(random()));
  int descriptor = -1;
  _wsopen_s(&descriptor, path.c_str(), _O_CREAT | _O_EXCL | _O_WRONLY | _O_BINARY | _O_NOINHERIT, _SH_DENYRW,
            _S_IREAD | _S_IWRITE);
  return {path, File(descriptor < 0 ? nullptr : _fdopen(descriptor, "wb"))};
}

OwnFile open_own_file(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(path, ignored))) return {};
  int descriptor = -1;
  _wsopen_s(&descriptor, path.c_str(), _O_RDONLY | _O_BINARY | _O_NOINHERIT, _SH_DENYNO, _S_IREAD);
  if (descriptor < 0) return {};
  const auto size = static_cast<std::uint64_t>(_filelengthi64(descriptor));
  return {File(_fdopen(descriptor, "rb")), size};
}

std::shared_ptr<const void> lock_folder(const std::filesystem::path& folder) {
  auto lock = std::make_unique<int>(-1);
  const int error = _wsopen_s(lock.get(), (folder / "lock").c_str(), _O_CREAT | _O_RDWR | _O_TEMPORARY,
                              _SH_DENYRW, _S_IREAD | _S_IWRITE);
  if (error == EACCES) return nullptr;
  if (error != 0) fail_to_lock(folder, error);
  return std::shared_ptr<const int>(lock.release(), [](const int* own) {
    _close(*own);
    delete own;
  });
}

std::optional<std::filesystem::path> user_cache_directory() {
  if (const auto folder = environment("LOCALAPPDATA")) return *folder;
  return std::nullopt;
}

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(_getpid());
}

bool is_terminal(std::FILE* stream) {
  return _isatty(_fileno(stream)) != 0;
}

bool call_in_forks(void (* /*function*/)()) noexcept {
  return true;
}

void use_large_pages(void* /*begin*/, std::size_t /*bytes*/) noexcept {}

void give_back_free_memory() noexcept {}

std::string processor_name() {
  return environment("PROCESSOR_IDENTIFIER").value_or("unknown");
}

std::string system_name() {
  return environment("OS").value_or("Windows");
}

#else

namespace {

/// The rest of the first line of a file that begins with a key, without unwanted characters around it; empty
/// if there is no such line.
std::string value_in(const char* file, std::string_view key, const char* unwanted) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    if (!line.starts_with(key)) continue;
    const std::size_t first = line.find_first_not_of(unwanted, key.size());
    if (first == std::string::npos) break;
    return line.substr(first, line.find_last_not_of(unwanted) + 1 - first);
  }
  return {};
}

utsname names_of_system() {
  utsname names{};
  uname(&names);
  return names;
}

/// Takes the descriptor, if it is one.
File to_stream(int descriptor, const char* mode) {
  if (descriptor < 0) return nullptr;
  File stream(fdopen(descriptor, mode));
  if (!stream) close(descriptor);
  return stream;
}

bool is_own(const struct stat& status) {
  const bool is_of_user = status.st_uid == geteuid() || status.st_uid == 0;
  return S_ISREG(status.st_mode) && is_of_user && (status.st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

}  // namespace

void create_private_folder(const std::filesystem::path& folder) {
  std::filesystem::path path;
  for (const std::filesystem::path& part : folder) {
    path /= part;
    (void)mkdir(path.c_str(), S_IRWXU);
  }
}

NewFile create_private_file(const std::filesystem::path& folder) {
  std::string path = (folder / "new-XXXXXX").string();
  File stream = to_stream(mkostemp(path.data(), O_CLOEXEC), "wb");
  return {path, std::move(stream)};
}

OwnFile open_own_file(const std::filesystem::path& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  File stream = to_stream(descriptor, "rb");
  struct stat status {};
  if (!stream || fstat(descriptor, &status) != 0 || !is_own(status)) return {};
  return {std::move(stream), static_cast<std::uint64_t>(status.st_size)};
}

std::shared_ptr<const void> lock_folder(const std::filesystem::path& folder) {
  auto file = std::make_unique<int>(-1);  // before it is opened, since this may throw
  *file = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (*file < 0) fail_to_lock(folder, errno);
  const std::shared_ptr<const int> lock(file.release(), [](const int* own) {
    close(*own);
    delete own;
  });
  if (flock(*lock, LOCK_EX | LOCK_NB) == 0) return lock;
  if (errno != EWOULDBLOCK) fail_to_lock(folder, errno);
  return nullptr;
}

std::optional<std::filesystem::path> user_cache_directory() {
  const auto folder = environment("XDG_CACHE_HOME");
  if (folder && std::filesystem::path(*folder).is_absolute()) return *folder;
  if (const auto home = environment("HOME")) return std::filesystem::path(*home) / ".cache";
  return std::nullopt;
}

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(getpid());
}

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) != 0;
}

bool call_in_forks(void (*function)()) noexcept {
  return pthread_atfork(nullptr, nullptr, function) == 0;
}

void use_large_pages([[maybe_unused]] void* begin, [[maybe_unused]] std::size_t bytes) noexcept {
#ifdef MADV_HUGEPAGE
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  const std::size_t before = reinterpret_cast<std::uintptr_t>(begin) % page;
  (void)madvise(static_cast<std::byte*>(begin) - before, before + bytes, MADV_HUGEPAGE);
#endif
}

void give_back_free_memory() noexcept {
#ifdef __GLIBC__
  (void)malloc_trim(0);  // what threads have freed stays in their arenas
#endif
}

std::string processor_name() {
  std::string name = value_in("/proc/cpuinfo", "model name", "\t :");
  if (!name.empty()) return name;
  const utsname names = names_of_system();
  return &names.machine[0];
}

std::string system_name() {
  std::string name = value_in("/etc/os-release", "PRETTY_NAME=", "\"'");
  if (!name.empty()) return name;
  const utsname names = names_of_system();
  return std::string(&names.sysname[0]) + " " + &names.release[0];
}

#endif

}  // namespace broadcl
