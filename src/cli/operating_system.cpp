#include "cli/operating_system.hpp"

#include <cerrno>
#include <system_error>
#include <utility>

#include <broadcl/error.hpp>

#include "base/system.hpp"
#include "cli/text.hpp"

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <process.h>
#include <share.h>
#include <sys/stat.h>
#else
#include <fcntl.h>
#include <sys/file.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <fstream>
#include <string_view>
#endif

namespace broadcl::cli {
namespace {

[[noreturn]] void fail_to_lock(const std::filesystem::path& folder, int error) {
  throw Error("cannot lock the folder " + quoted(folder) + ": " + std::generic_category().message(error));
}

}  // namespace

#ifdef _WIN32

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

}  // namespace

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

}  // namespace broadcl::cli
