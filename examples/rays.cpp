// Rays and nearest: what is nearest to points, and what a ray and a moving box meet, in order.
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

void ask() {
  // [nearest]
  broadcl::BroadPhase broad_phase;
  for (int k = 0; k < 5; ++k) {
    const auto x = static_cast<float>(2 * k);
    broad_phase.add({{x, 0, 0}, {x + 1, 1, 1}});  // a row of cubes with gaps between them
  }
  const std::vector<float> numbers{5.5F, 0, 0, 20, 0, 0};  // x, y, z of each
  const auto points = broadcl::BoxView::corners(numbers.data(), numbers.data(), 2);
  const broadcl::Hits near = broad_phase.nearest(points, {.limit = 3});
  for (std::size_t point = 0; point < near.size(); ++point) {
    for (std::size_t k = near.offsets[point]; k < near.offsets[point + 1]; ++k) {
      std::printf("%u is %.1f from point %zu\n", near.ids[k], std::sqrt(near.squared_distances[k]), point);
    }
  }
  // [nearest]

  // [along]
  const std::vector<broadcl::Aabb> starts{{{-2, 0.5F, 0}, {-2, 0.5F, 0}},  // a ray
                                          {{8, 0, 3}, {9, 0.5F, 4}}};      // a box, above the last cube
  const std::vector<std::array<float, 3>> directions{{1, 0, 0}, {-2, 0, -1}};
  const std::vector<float> lengths{7.5F, 10};
  const broadcl::Hits met = broad_phase.along(starts, directions, lengths);
  for (std::size_t start = 0; start < met.size(); ++start) {
    for (std::size_t k = met.offsets[start]; k < met.offsets[start + 1]; ++k) {
      std::printf("%zu meets %u at %.1f\n", start, met.ids[k], met.times[k]);
    }
  }
  const broadcl::Hits first = broad_phase.along(starts, directions, lengths, {.limit = 1});
  std::printf("the closest are %u and %u\n", first.ids[0], first.ids[1]);
  // [along]
}

}  // namespace

int main() try { ask(); } catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
