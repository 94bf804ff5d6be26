#include "cli/operating_system.hpp"

#ifdef _WIN32
#include <io.h>
#include <process.h>
#else
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

#else

std::uint32_t process_id() {
  return static_cast<std::uint32_t>(getpid());
}

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) != 0;
}

#endif

}  // namespace broadcl::cli
