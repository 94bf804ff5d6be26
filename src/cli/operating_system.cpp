#include "cli/operating_system.hpp"

#include <cstdlib>

#include <broadcl/error.hpp>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#else
#include <cerrno>
#include <system_error>

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

void replace_process(std::vector<std::string> arguments) {
  throw Error("on Windows, this cannot start " + arguments.front() + "; see docs/see.md");
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

void replace_process(std::vector<std::string> arguments) {
  std::vector<char*> pointers;
  pointers.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  execvp(pointers.front(), pointers.data());
  throw Error("cannot start " + arguments.front() + ": " + std::generic_category().message(errno) +
              "; install it");
}

#endif

}  // namespace broadcl::cli
