#include "cli/compiling.hpp"

#include <iostream>
#include <set>

#include "cli/text.hpp"

namespace broadcl::cli {

void announce_compiling(const Device& device, const std::string& cache_folder) {
  static std::set<std::string> announced;
  if (!announced.insert(device.label()).second) return;
  std::string text = "compiling kernels for " + one_line(device.label());
  if (cache_folder.empty()) {
    text +=
        ", at each start because there is no cache folder that only you can write; BROADCL_CACHE_DIR can "
        "name one";
  } else {
    text += ", once; they are stored in " + cli::quoted(cache_folder);
  }
  std::cerr << text << std::endl;
}

}  // namespace broadcl::cli
