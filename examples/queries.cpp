// Queries: which objects are where, and the partners of one; then many boxes and many points, once.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

void print(const char* what, const std::vector<std::uint32_t>& ids) {
  std::printf("%s:", what);
  for (const std::uint32_t id : ids) std::printf(" %u", id);
  std::printf("\n");
}

void ask() {
  // [where]
  broadcl::BroadPhase broad_phase;
  for (int k = 0; k < 5; ++k) {
    const auto x = static_cast<float>(k);
    broad_phase.add({{x, 0, 0}, {x + 1, 1, 1}});  // a row of cubes, each of which touches the next
  }
  std::vector<std::uint32_t> ids;
  broad_phase.overlapping({{0.5F, 0, 0}, {2.5F, 1, 1}}, ids);
  print("in a box", ids);
  broad_phase.overlapping({{1.5F, 0.5F, 0.5F}, {1.5F, 0.5F, 0.5F}}, ids);
  print("at a point", ids);
  broad_phase.overlapping({{8, 0, 0}, {9, 1, 1}}, ids, {.within = 3.5});
  print("near a box", ids);

  (void)broad_phase.update();
  print("partners of 2", broad_phase.partners(2));
  // [where]
}

void ask_for_many() {
  // [many]
  const std::vector<broadcl::Aabb> rooms{{{0, 0, 0}, {4, 4, 3}}, {{4, 0, 0}, {9, 4, 3}}};
  const std::vector<broadcl::Aabb> people{
      {{1, 1, 0}, {1, 1, 0}}, {{4, 2, 0}, {4, 2, 0}}, {{20, 1, 0}, {20, 1, 0}}};
  const broadcl::Hits hits = broadcl::overlapping(rooms, people);
  for (std::size_t person = 0; person < hits.size(); ++person) {
    for (const std::uint32_t room : hits[person]) std::printf("person %zu is in room %u\n", person, room);
  }
  // [many]
}

}  // namespace

int main() try {
  ask();
  ask_for_many();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
