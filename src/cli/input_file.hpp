#pragma once

#include <broadcl/error.hpp>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

#include "cli/text.hpp"

namespace broadcl::cli {

/// Opens a file for reading.
/// @throws Error, naming the file, if it cannot be read.
[[nodiscard]] inline std::ifstream open_input(const std::filesystem::path& file) {
  std::error_code ignored;
  if (std::filesystem::is_directory(file, ignored)) {
    throw Error(quoted(file) + " is a directory; name a file to read");
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw Error("cannot read " + quoted(file) + ": " + std::generic_category().message(errno));
  return stream;
}

}  // namespace broadcl::cli
