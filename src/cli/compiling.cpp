#include "cli/compiling.hpp"

#include <broadcl/error.hpp>
#include <filesystem>
#include <iostream>
#include <set>
#include <system_error>

#include "cli/output_file.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

namespace fs = std::filesystem;

/// Whether files can be written to a folder, which is made if it does not exist.
bool is_writable(const fs::path& folder) {
  std::error_code ignored;
  fs::create_directories(folder, ignored);
  try {
    const OutputFile probe(folder / "probe");
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

void announce_compiling(const Device& device, const std::string& cache_folder) {
  static std::set<std::string> announced;
  if (!announced.insert(device.label()).second) return;
  std::string text = "compiling kernels for " + one_line(device.label());
  if (cache_folder.empty()) {
    text += ", at each start because there is no cache folder";
  } else if (is_writable(cache_folder)) {
    text += ", once; they are stored in " + cli::quoted(cache_folder);
  } else {
    text += ", at each start because the cache folder " + cli::quoted(cache_folder) + " cannot be written";
  }
  std::cerr << text << std::endl;
}

}  // namespace broadcl::cli
