// Moving boxes without a physics engine: which pairs began and which ceased to overlap, frame by frame.
#include <cstdio>
#include <exception>
#include <string>

#include <broadcl/broad_phase.hpp>

int main() try {
  // [core]
  broadcl::BroadPhase broad_phase;  // starts on the host, moves to the best GPU when that is faster
  const auto at = [](float x) { return broadcl::Aabb{{x, 0, 0}, {x + 1, 1, 1}}; };
  for (int k = 0; k < 5; ++k) broad_phase.add(at(2.0F * static_cast<float>(k)));
  const std::uint32_t traveller = broad_phase.add(at(-1.5F));

  const broadcl::Device* device = broad_phase.device();
  std::printf("%s on %s\n", std::string(broad_phase.algorithm().name).c_str(),
              device != nullptr ? device->label().c_str() : "the host");
  for (int frame = 0; frame < 6; ++frame) {
    broad_phase.move(traveller, at(-1.5F + 2.0F * static_cast<float>(frame)));
    const broadcl::Delta delta = broad_phase.update();
    for (const broadcl::Pair& pair : delta.removed)
      std::printf("frame %d: %u and %u stop overlapping\n", frame, pair.a, pair.b);
    for (const broadcl::Pair& pair : delta.added)
      std::printf("frame %d: %u and %u start overlapping\n", frame, pair.a, pair.b);
  }
  // [core]
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
