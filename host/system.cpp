#include "system.hpp"

#include <cstdlib>

#ifdef _WIN32
#include <io.h>
#include <process.h>
#else
#include <sys/utsname.h>
#include <unistd.h>

#include <fstream>
#include <string_view>
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

std::string processor_name() {
  return environment("PROCESSOR_IDENTIFIER").value_or("unknown");
}

std::string system_name() {
  return environment("OS").value_or("Windows");
}

#else

namespace {

/// The rest of the first line of a file that begins with a key, without the characters around it that are not
/// wanted; empty where there is none.
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

}  // namespace

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
