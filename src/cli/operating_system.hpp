#pragma once

#include <cstdio>
#include <string>
#include <vector>

/// What differs between operating systems, and only the program uses.
namespace broadcl::cli {

[[nodiscard]] bool is_terminal(std::FILE* stream);

/// Reads the bytes of standard input as they are. (Windows changes line ends otherwise.)
void make_standard_input_binary();

/// Unsets BROADCL_RECORD, for a verb that reads a recording, which may be the file that the variable names.
void stop_recording();

/// Name, release and processor of the system: "Linux 6.1.0-32-amd64 x86_64". (On Windows, only its name.)
[[nodiscard]] std::string operating_system();

/// Runs a program, found as a shell finds it, in place of this one.
/// @param arguments Begin with the name of the program.
/// @throws Error if it cannot be started. On Windows, none can.
[[noreturn]] void replace_process(std::vector<std::string> arguments);

}  // namespace broadcl::cli
