// Going back: a game that plays frames again when an input comes late; a list of pairs that follows; and some
// of many worlds that begin anew.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <set>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace {

broadcl::Aabb at(float x) {
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

void print(std::size_t frame, const broadcl::Delta& delta) {
  for (const broadcl::Pair& pair : delta.removed)
    std::printf("frame %zu: %u and %u stop overlapping\n", frame, pair.a, pair.b);
  for (const broadcl::Pair& pair : delta.added)
    std::printf("frame %zu: %u and %u start overlapping\n", frame, pair.a, pair.b);
}

void roll_back() {
  // [rollback]
  broadcl::BroadPhase broad_phase;
  const std::uint32_t player = broad_phase.add(at(0));
  broad_phase.add(at(2));
  broad_phase.add(at(-2));
  (void)broad_phase.update();
  std::vector<float> inputs{1, 1, 1, 1};  // by which the player moves, as far as is known
  std::vector<broadcl::State> states;     // before each frame
  const auto play = [&](std::size_t first) {
    for (std::size_t frame = first; frame < inputs.size(); ++frame) {
      states.push_back(broad_phase.save());
      broad_phase.move(player, at(broad_phase.box(player).lower[0] + inputs[frame]));
      print(frame, broad_phase.update());
    }
  };
  play(0);
  std::printf("the player turned round in frame 1\n");
  inputs = {1, -1, -1, -1};
  (void)broad_phase.restore(states[1]);
  states.erase(states.begin() + 1, states.end());
  play(1);
  // [rollback]
}

void follow() {
  // [list]
  std::set<broadcl::Pair> contacts;
  const auto apply = [&](const broadcl::Delta& delta) {
    for (const broadcl::Pair& pair : delta.removed) contacts.erase(pair);
    contacts.insert(delta.added.begin(), delta.added.end());
  };
  broadcl::BroadPhase broad_phase;
  for (const float x : {0.0F, 1.0F, 2.0F}) broad_phase.add(at(x));
  apply(broad_phase.update());
  const broadcl::State state = broad_phase.save();
  broad_phase.remove(1);
  broad_phase.move(2, at(0.5F));
  apply(broad_phase.update());
  std::printf("%zu contact\n", contacts.size());
  apply(broad_phase.restore(state));
  std::printf("%zu contacts again\n", contacts.size());
  // [list]
}

void begin_anew() {
  // [worlds]
  constexpr std::uint32_t worlds = 4;
  constexpr std::uint32_t objects = 2;  // in each world
  std::vector<broadcl::Aabb> boxes;
  std::vector<broadcl::Filter> filters;
  for (std::uint32_t id = 0; id < worlds * objects; ++id) {
    boxes.push_back(at(id % objects == 0 ? 0 : 3));
    filters.push_back({.world = id / objects});
  }
  broadcl::BroadPhase broad_phase;
  broad_phase.add(broadcl::BoxView(boxes), filters);
  for (std::uint32_t world = 0; world < worlds; ++world) broad_phase.move(world * objects + 1, at(1));
  std::printf("%zu pairs\n", broad_phase.update().added.size());

  std::vector<std::uint32_t> ids;  // of the objects of worlds 1 and 3, whose episodes are over
  for (const std::uint32_t id : broad_phase.ids())
    if (id / objects == 1 || id / objects == 3) ids.push_back(id);
  std::vector<broadcl::Aabb> first;
  for (const std::uint32_t id : ids) first.push_back(boxes[id]);
  broad_phase.move(ids, broadcl::BoxView(first));
  std::printf("%zu end\n", broad_phase.update().removed.size());
  // [worlds]
}

}  // namespace

int main() try {
  roll_back();
  follow();
  begin_anew();
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
