#include <cstdio>

#include <broadcl/broad_phase.hpp>

int main() {
  broadcl::BroadPhase broad_phase;          // starts on the host, moves to a GPU when that is faster
  broad_phase.add({{0, 0, 0}, {1, 1, 1}});  // lower corner, upper corner
  const auto id = broad_phase.add({{2, 0, 0}, {3, 1, 1}});
  broad_phase.move(id, {{0.5F, 0, 0}, {1.5F, 1, 1}});
  const broadcl::Delta delta = broad_phase.update();  // what changed since the last update
  for (const broadcl::Pair& pair : delta.added) std::printf("%u and %u overlap\n", pair.a, pair.b);
  for (const broadcl::Pair& pair : delta.removed) std::printf("%u and %u are apart\n", pair.a, pair.b);
}
