// Pairs of two sets: which edges of a mesh may touch which faces; then faces and vertices, except those that
// share a vertex; then sets that move.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

void find_once() {
  // [once]
  const std::vector<broadcl::Aabb> edges{{{0, 0, 0}, {1, 0, 0}}, {{5, 0, 0}, {6, 1, 0}}};
  const std::vector<broadcl::Aabb> faces{
      {{0, 0, 0}, {2, 2, 0}}, {{5, 1, 0}, {7, 2, 0}}, {{9, 9, 9}, {9, 9, 9}}};
  for (const broadcl::Pair& pair : broadcl::overlapping_pairs(edges, faces)) {
    std::printf("edge %u and face %u\n", pair.a, pair.b);
  }
  // [once]
}

void leave_out_shared_vertices() {
  // [sharing]
  // The vertices of each face, of a mesh of two triangles, and the boxes of all faces and vertices.
  const std::vector<std::uint32_t> corners{0, 1, 2, 2, 1, 3};
  const std::vector<std::uint32_t> numbers{0, 1, 2, 3};
  const std::vector<broadcl::Aabb> faces{{{0, 0, 0}, {1, 1, 0}}, {{0, 0, 0}, {1, 1, 0}}};
  const std::vector<broadcl::Aabb> vertices{
      {{0, 0, 0}, {0, 0, 0}}, {{1, 0, 0}, {1, 0, 0}}, {{0, 1, 0}, {0, 1, 0}}, {{1, 1, 0}, {1, 1, 0}}};
  const std::vector<broadcl::Pair> own = broadcl::pairs_that_share(corners, 3, numbers, 1);
  for (const broadcl::Pair& pair : broadcl::overlapping_pairs(faces, vertices, own)) {
    std::printf("face %u and vertex %u\n", pair.a, pair.b);
  }
  // [sharing]
}

void follow() {
  // [moving]
  broadcl::BroadPhase broad_phase;
  const auto edge = broad_phase.add({{0, 0, 0}, {1, 0, 0}}, broadcl::Filter::first_set);
  broad_phase.add({{0, 0, 0}, {2, 0, 0}}, broadcl::Filter::first_set);  // never pairs with the other edge
  broad_phase.add({{4, 0, 0}, {5, 1, 0}}, broadcl::Filter::second_set);
  (void)broad_phase.update();
  broad_phase.move(edge, {{3, 0, 0}, {4, 0, 0}});
  std::printf("%zu new pair\n", broad_phase.update().added.size());
  // [moving]
}

}  // namespace

int main() try {
  find_once();
  leave_out_shared_vertices();
  follow();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
