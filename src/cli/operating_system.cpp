#include "cli/operating_system.hpp"

#include <cstdlib>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#else
#include <sys/utsname.h>
#include <unistd.h>
#endif

namespace broadcl::cli {

#ifdef _WIN32

bool is_terminal(std::FILE* stream) {
  return _isatty(_fileno(stream)) != 0;
}

void make_standard_input_binary() {
  (void)_setmode(_fileno(stdin), _O_BINARY);
}

void stop_recording() {
  (void)_putenv_s("BROADCL_RECORD", "");
}

std::string operating_system() {
  return "Windows";
}

#else

bool is_terminal(std::FILE* stream) {
  return isatty(fileno(stream)) != 0;
}

void make_standard_input_binary() {}

void stop_recording() {
  (void)unsetenv("BROADCL_RECORD");  // NOLINT(concurrency-mt-unsafe)
}

std::string operating_system() {
  utsname system{};
  uname(&system);
  return std::string(system.sysname) + " " + system.release + " " + system.machine;
}

#endif

}  // namespace broadcl::cli
