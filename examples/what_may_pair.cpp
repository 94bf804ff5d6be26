// What may pair: groups, layers, one-sided rules and other recipes. All objects are in the same place if
// nothing else is said.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

constexpr broadcl::Aabb box{{0, 0, 0}, {1, 1, 1}};

void print(const char* what, const std::vector<broadcl::Pair>& pairs) {
  std::printf("%s:", what);
  for (const broadcl::Pair& pair : pairs) std::printf(" %u-%u", pair.a, pair.b);
  std::printf("\n");
}

void print(const char* what, broadcl::BroadPhase& broad_phase) {
  (void)broad_phase.update();
  print(what, broad_phase.pairs());
}

void use_groups() {
  // [groups]
  enum Group : std::uint32_t { player = 1, enemy = 2, shot = 4 };
  broadcl::BroadPhase broad_phase;
  broad_phase.add(box, {.group = player, .mask = enemy});
  broad_phase.add(box, {.group = enemy, .mask = player | shot});
  broad_phase.add(box, {.group = shot, .mask = enemy});
  print("groups", broad_phase);  // 0-1 1-2
  // [groups]
}

void use_layers() {
  // [layers]
  enum Layer : std::size_t { ground, wheels, debris };
  constexpr std::array<std::array<bool, 3>, 3> matrix{{
      {false, true, true},  // ground
      {true, true, false},  // wheels
      {true, false, false}  // debris
  }};
  const std::vector<broadcl::Filter> filters =
      broadcl::filters_from_layers(3, [&](std::size_t a, std::size_t b) { return matrix.at(a).at(b); });
  broadcl::BroadPhase broad_phase;
  for (const Layer layer : {ground, ground, wheels, debris, debris}) broad_phase.add(box, filters[layer]);
  print("layers", broad_phase);  // 0-2 1-2 0-3 1-3 0-4 1-4
  // [layers]
}

void use_many_layers() {
  // [many]
  // Layers 0 to 3 are static, and pair with the others only.
  const std::vector<broadcl::Filter> filters =
      broadcl::filters_from_layers(50, [](std::size_t a, std::size_t b) { return a >= 4 || b >= 4; });
  broadcl::BroadPhase broad_phase;
  for (const std::size_t layer : {0U, 3U, 4U, 49U}) broad_phase.add(box, filters[layer]);
  print("50 layers", broad_phase);  // 0-2 1-2 0-3 1-3 2-3
  // [many]
}

void use_one_sided_bits() {
  // [sided]
  // The floor has no type of its own, so nothing else would pair with it; but it accepts type 1.
  const std::vector<std::uint32_t> contype{0, 1, 1};
  const std::vector<std::uint32_t> conaffinity{1, 0, 0};
  broadcl::BroadPhase broad_phase;
  for (const broadcl::Filter& filter : broadcl::filters_from_one_sided(contype, conaffinity))
    broad_phase.add(box, filter);
  print("one-sided", broad_phase);  // 0-1 0-2
  // [sided]
}

void use_bodies() {
  // [bodies]
  broadcl::BroadPhase broad_phase;
  for (const std::uint32_t body : {0U, 0U, 1U}) broad_phase.add(box, {.body = body});
  const auto ghost = broad_phase.add(box);
  broad_phase.set_exclusions(std::vector<broadcl::Pair>{{2, ghost}});
  print("bodies", broad_phase);  // 0-2 1-2 0-3 1-3
  // [bodies]
}

void use_static_objects() {
  // [static]
  constexpr broadcl::Filter fixed{.group = 2, .mask = ~2U};
  broadcl::BroadPhase broad_phase;
  broad_phase.add(box, fixed);
  broad_phase.add(box, fixed);
  broad_phase.add(box);          // by default in group 1, with all bits in its mask
  print("static", broad_phase);  // 0-2 1-2
  // [static]
}

void ignore_the_first_pose() {
  // [pose]
  broadcl::BroadPhase broad_phase;
  for (const float x : {0.0F, 1.0F, 5.0F}) broad_phase.add({{x, 0, 0}, {x + 1, 1, 1}});
  (void)broad_phase.update();
  broad_phase.set_exclusions(broad_phase.pairs());  // the next update reports them as removed
  broad_phase.move(2, {{1, 0, 0}, {2, 1, 1}});
  print("without those of the first pose", broad_phase);  // 0-2 1-2
  // [pose]
}

void leave_out_shared_edges() {
  // [edges]
  // The second face shares an edge with the first, the third only a vertex.
  const std::vector<std::array<std::uint32_t, 3>> faces{{0, 1, 2}, {2, 1, 3}, {0, 4, 5}};
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> edges;
  std::vector<std::uint32_t> labels;  // three of each face
  for (const auto& [a, b, c] : faces) {
    for (const std::pair<std::uint32_t, std::uint32_t> edge :
         {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)}) {
      labels.push_back(edges.try_emplace(edge, static_cast<std::uint32_t>(edges.size())).first->second);
    }
  }
  broadcl::BroadPhase broad_phase;
  for (std::size_t k = 0; k < faces.size(); ++k) broad_phase.add(box);
  broad_phase.set_exclusions(broadcl::pairs_that_share(labels, 3));
  print("faces", broad_phase);  // 0-2 1-2
  // [edges]
}

void add_pairs() {
  // [extra]
  const std::vector<broadcl::Aabb> boxes{box, box, {{1, 0, 0}, {2, 1, 1}}, {{7, 0, 0}, {8, 1, 1}}};
  std::vector<broadcl::Pair> touching;
  for (const broadcl::Pair& pair : std::vector<broadcl::Pair>{{0, 2}, {1, 3}}) {
    if (overlaps(boxes[pair.a], boxes[pair.b])) touching.push_back(pair);
  }
  print("extra pairs", touching);  // 0-2
  // [extra]
}

void use_intervals() {
  // [open]
  // [0, 10), [10, 20) and [19, 30) on one axis.
  const std::vector<std::pair<float, float>> intervals{{0, 10}, {10, 20}, {19, 30}};
  broadcl::BroadPhase broad_phase;
  for (const auto& [lower, upper] : intervals) {
    const float last = std::nextafter(upper, -std::numeric_limits<float>::infinity());
    broad_phase.add({{lower, 0, 0}, {last, 0, 0}});
  }
  print("half-open", broad_phase);  // 1-2
  // [open]
}

}  // namespace

int main() try {
  use_groups();
  use_layers();
  use_many_layers();
  use_one_sided_bits();
  use_bodies();
  use_static_objects();
  ignore_the_first_pose();
  leave_out_shared_edges();
  add_pairs();
  use_intervals();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
