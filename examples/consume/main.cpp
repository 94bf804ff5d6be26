// Used by all of the projects in C++.
#include <broadcl/version.h>
#include <broadcl/broad_phase.hpp>
#include <cstdio>
#include <exception>
#include <vector>

int main() try {
  const std::vector<broadcl::Aabb> boxes = {{{0, 0, 0}, {1, 1, 1}}, {{1, 0, 0}, {2, 1, 1}}};
  const std::vector<broadcl::Pair> pairs = broadcl::overlapping_pairs(boxes);
  std::printf("BroadCL %s: %zu pair\n", BROADCL_VERSION_STRING, pairs.size());
  return pairs.size() == 1 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
