#include "system.hpp"

#include <cstdlib>

#ifdef _WIN32
#include <io.h>
#include <process.h>
#else
#include <unistd.h>
#endif

namespace broadcl {

std::optional<std::string> environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  if (value == nullptr || *value == '\0') return std::nullopt;
  return value;
}

#ifdef _WIN32

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

#else

std::optional<std::filesystem::path> user_cache_directory() {
  if (const auto folder = environment("XDG_CACHE_HOME")) return *folder;
  if (const auto home = environment("HOME")) return std::filesystem::path(*home) / ".cache";
  return std::nullopt;
}

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(getpid());
}

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) != 0;
}

#endif

}  // namespace broadcl
