// Distances: points within a distance of each other, and spheres that grow.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

void find_once() {
  // [once]
  const std::vector<double> atoms{0, 0, 0, 3, 0, 0, 3, 1.5, 0};  // x, y, z of each
  const auto points = broadcl::BoxView::corners(atoms.data(), atoms.data(), 3);
  const std::vector<broadcl::Pair> pairs = broadcl::overlapping_pairs(points, {}, {.distance = 3.2});
  const std::vector<double> squares = broadcl::squared_distances(points, pairs);
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    std::printf("%u and %u are %.2f apart\n", pairs[k].a, pairs[k].b, std::sqrt(squares[k]));
  }
  // [once]
}

void follow() {
  // [reaches]
  broadcl::BroadPhase broad_phase;
  const auto sphere = [&](float x, float radius) {
    return broad_phase.add({{x, 0, 0}, {x, 0, 0}}, broadcl::Filter(), radius);
  };
  const std::uint32_t first = sphere(0, 1);
  sphere(3, 1);
  sphere(6, 2.5F);
  for (const broadcl::Pair& pair : broad_phase.update().added)
    std::printf("%u and %u meet\n", pair.a, pair.b);

  const float radius = 2;
  broad_phase.set_reach({&first, 1}, {&radius, 1});
  for (const broadcl::Pair& pair : broad_phase.update().added)
    std::printf("%u has grown and meets %u\n", pair.a, pair.b);
  // [reaches]
}

}  // namespace

int main() try {
  find_once();
  follow();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
