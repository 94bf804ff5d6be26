#include "cli/compiling.hpp"

#include <iostream>
#include <set>

#include "cli/text.hpp"

namespace broadcl::cli {

void announce_compiling(const Device& device, const std::string& kept_in) {
  static std::set<std::string> announced;
  if (!announced.insert(device.label()).second) return;
  std::cerr << "building kernels for " << one_line(device.label()) << ", once; "
            << (kept_in.empty() ? "not kept, as there is no folder for caches"
                                : "kept in " + cli::quoted(kept_in))
            << std::endl;
}

}  // namespace broadcl::cli
