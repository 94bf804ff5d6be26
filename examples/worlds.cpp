// Many small worlds in one search, as batched simulations have them, with a ground that all of them share.
#include <cstdint>
#include <cstdio>
#include <exception>

#include <broadcl/broad_phase.hpp>

int main() try {
  // [worlds]
  broadcl::BroadPhase broad_phase;
  constexpr std::uint32_t worlds = 1000;
  for (std::uint32_t world = 0; world < worlds; ++world) {
    const auto x = static_cast<float>(world % 3);  // in one world of three the two boxes overlap
    broad_phase.add({{0, 0, 0}, {1, 1, 1}}, {.world = world});
    broad_phase.add({{x + 0.5F, 0.5F, 0}, {x + 1.5F, 1.5F, 1}}, {.world = world});
  }
  broad_phase.add({{-9, -9, -1}, {9, 9, 0}}, {.world = broadcl::Filter::all_worlds});
  const broadcl::Delta delta = broad_phase.update();
  std::printf("%zu pairs: each box and the ground, and 334 of two boxes\n", delta.added.size());
  // [worlds]
  return delta.added.size() == 2 * worlds + 334 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
