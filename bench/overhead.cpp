// The C++ side of bench/overhead.py: the same frames, timed here.
//   broadcl_overhead FILE MOVING FRAMES ALGORITHM DEVICE
// FILE has two arrays of boxes, float32, six numbers per box, which are used in turn: if MOVING is 0 all
// boxes are written to map(), otherwise this many are moved. Prints the seconds of each frame, and of its
// update() alone.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::vector<broadcl::Aabb> read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  file.exceptions(std::ios::badbit);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  std::vector<broadcl::Aabb> boxes(bytes.size() / sizeof(broadcl::Aabb));
  std::memcpy(boxes.data(), bytes.data(), boxes.size() * sizeof(broadcl::Aabb));
  return boxes;
}

void run(const std::vector<std::string>& arguments) {
  const std::vector<broadcl::Aabb> all = read(arguments.at(1));
  const std::size_t n = all.size() / 2;
  const auto moving = static_cast<std::uint32_t>(std::stoul(arguments.at(2)));
  broadcl::BroadPhase broad_phase({.device = arguments.at(5), .algorithm = arguments.at(4)});
  for (const broadcl::Aabb& box : std::span(all).first(n)) broad_phase.add(box);
  broad_phase.update();
  for (unsigned long frame = 1; frame <= std::stoul(arguments.at(3)); ++frame) {
    const std::span<const broadcl::Aabb> boxes = std::span(all).subspan(frame % 2 * n, n);
    const auto start = Clock::now();
    if (moving == 0) std::ranges::copy(boxes, broad_phase.map(n).begin());
    for (std::uint32_t id = 0; id < moving; ++id) broad_phase.move(id, boxes[id]);
    const auto moved = Clock::now();
    broad_phase.update();
    const double update = seconds_since(moved);
    std::printf("%.9f %.9f\n", seconds_since(start), update);
  }
}

}  // namespace

int main(int argc, char** argv) try { run({argv, argv + argc}); } catch (const std::exception& error) {
  std::fprintf(stderr, "broadcl_overhead: %s\n", error.what());
  return 1;
}
