#include "base/system.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <initializer_list>
#include <string_view>
#include <system_error>

#ifdef _WIN32
#include <process.h>
#include <share.h>
#else
#include <fcntl.h>
#include <pthread.h>
#include <sys/file.h>
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

bool make_private_folder(const std::filesystem::path& folder) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  return std::filesystem::is_directory(folder, failure);
}

File create_private_file(const std::filesystem::path& path) {
  return File(std::fopen(path.string().c_str(), "wbx"));
}

File open_unshared(const std::filesystem::path& path) {
  File file(_wfsopen(path.c_str(), L"wb", _SH_DENYWR));
  if (file) (void)std::setvbuf(file.get(), nullptr, _IONBF, 0);
  return file;
}

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(_getpid());
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

bool make_private_folder(const std::filesystem::path& folder) {
  std::filesystem::path path;
  for (const std::filesystem::path& part : folder) {
    path /= part;
    (void)mkdir(path.c_str(), S_IRWXU);
  }
  struct stat status {};
  if (stat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)) return false;
  const bool is_of_user = status.st_uid == geteuid() || status.st_uid == 0;
  return is_of_user && (status.st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

File create_private_file(const std::filesystem::path& path) {
  const int descriptor = open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, S_IRUSR | S_IWUSR);
  File file(descriptor < 0 ? nullptr : fdopen(descriptor, "wb"));
  if (!file && descriptor >= 0) close(descriptor);
  return file;
}

File open_unshared(const std::filesystem::path& path) {
  constexpr mode_t everybody =
      S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP | S_IROTH | S_IWOTH;  // without the umask
  const int descriptor = open(path.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, everybody);
  if (descriptor < 0) return nullptr;
  if (flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(descriptor);
    errno = EWOULDBLOCK;
    return nullptr;
  }
  (void)!ftruncate(descriptor, 0);  // which devices do not need
  File file(fdopen(descriptor, "wb"));
  if (file) {
    (void)std::setvbuf(file.get(), nullptr, _IONBF, 0);
  } else {
    close(descriptor);
  }
  return file;
}

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(getpid());
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
