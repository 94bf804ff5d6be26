#include "cli/operating_system.hpp"

#ifdef _WIN32
#include <io.h>
#include <process.h>
#else
#include <sys/utsname.h>
#include <unistd.h>
#endif

namespace broadcl::cli {

#ifdef _WIN32

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(_getpid());
}

bool is_terminal(std::FILE* stream) {
  return _isatty(_fileno(stream)) != 0;
}

std::string operating_system() {
  return "Windows";
}

#else

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(getpid());
}

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) != 0;
}

std::string operating_system() {
  utsname system{};
  uname(&system);
  return std::string(system.sysname) + " " + system.release + " " + system.machine;
}

#endif

}  // namespace broadcl::cli
