#include "cli/compiling.hpp"

#include <iostream>
#include <set>

#include "cli/text.hpp"

namespace broadcl::cli {

void announce_compiling(const Device& device, const std::string& cache_folder) {
  static std::set<std::string> announced;
  if (!announced.insert(device.label()).second) return;
  std::cerr << "compiling kernels for " << one_line(device.label())
            << (cache_folder.empty() ? ", at each start because there is no cache folder"
                                     : ", once; they are stored in " + cli::quoted(cache_folder))
            << std::endl;
}

}  // namespace broadcl::cli
