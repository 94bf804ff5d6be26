#include "base/system.hpp"

#include <algorithm>
#include <cstdlib>
#include <initializer_list>
#include <string_view>
#include <system_error>
#include <utility>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <share.h>
#include <sys/stat.h>

#include <random>
#else
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

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

std::optional<std::filesystem::path> user_cache_directory() {
  if (const auto folder = environment("LOCALAPPDATA")) return *folder;
  return std::nullopt;
}

bool call_in_forks(void (* /*function*/)()) noexcept {
  return true;
}

void use_large_pages(void* /*begin*/, std::size_t /*bytes*/) noexcept {}

void give_back_free_memory() noexcept {}

#else

namespace {

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

std::optional<std::filesystem::path> user_cache_directory() {
  const auto folder = environment("XDG_CACHE_HOME");
  if (folder && std::filesystem::path(*folder).is_absolute()) return *folder;
  if (const auto home = environment("HOME")) return std::filesystem::path(*home) / ".cache";
  return std::nullopt;
}

bool call_in_forks(void (*function)()) noexcept {
  return pthread_atfork(nullptr, nullptr, function) == 0;
}

void use_large_pages([[maybe_unused]] void* begin, [[maybe_unused]] std::size_t bytes) noexcept {
#ifdef MADV_HUGEPAGE
  constexpr std::size_t least = std::size_t{4} << 20U;  // below, they would be shared with other memory
  if (bytes < least) return;
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

#endif

#ifdef __linux__

bool may_have_gpu(const std::filesystem::path& folder) {
  std::error_code failure;
  const auto has_file = [&](const std::filesystem::path& in, std::initializer_list<std::string_view> begin) {
    for (std::filesystem::directory_iterator file(in, failure), end; !failure && file != end;
         file.increment(failure)) {
      const std::string name = file->path().filename().string();
      if (std::ranges::any_of(begin, [&](std::string_view text) { return name.starts_with(text); }))
        return true;
    }
    return false;
  };
  return has_file(folder, {"nvidia", "kfd", "dxg", "mali", "kgsl", "pvr"}) || failure ||
         has_file(folder / "dri", {"render"});
}

#else

bool may_have_gpu(const std::filesystem::path& /*folder*/) {
  return true;
}

#endif

}  // namespace broadcl
