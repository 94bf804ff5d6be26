#include "scenes/motions.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "scenes/generators.hpp"

namespace broadcl::scenes {
namespace {

using Eigen::Vector3f;
using Ids = std::vector<std::uint32_t>;
using Step = std::function<void(Motion&)>;
/// Which objects do something in a frame.
using Who = std::function<Ids(const Motion&, Random&)>;
using How = std::function<void(Motion&, std::uint32_t id)>;

const Vector3f middle = Vector3f::Constant(0.5F);

Vector3f corner(const std::array<float, 3>& corner) {
  return {corner[0], corner[1], corner[2]};
}
Vector3f centre(const Aabb& box) {
  return (corner(box.lower) + corner(box.upper)) / 2;
}
Vector3f half(const Aabb& box) {
  return (corner(box.upper) - corner(box.lower)) / 2;
}
Aabb box_at(const Vector3f& at, const Vector3f& half) {
  return {{at.x() - half.x(), at.y() - half.y(), at.z() - half.z()},
          {at.x() + half.x(), at.y() + half.y(), at.z() + half.z()}};
}
Aabb cube_at(const Vector3f& at, float edge) {
  return box_at(at, Vector3f::Constant(edge / 2));
}
Aabb moved_to(const Aabb& box, const Vector3f& at) {
  return box_at(at, half(box));
}

std::size_t part_of(std::size_t n, float share) {
  return static_cast<std::size_t>(std::ceil(share * static_cast<float>(n)));
}

// Who.

Ids all(const Motion& motion, Random& /*random*/) {
  Ids ids;
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    if (motion.contains(id)) ids.push_back(id);
  }
  return ids;
}
Who those(const std::function<bool(const Motion&, std::uint32_t)>& condition) {
  return [=](const Motion& motion, Random& random) {
    Ids ids = all(motion, random);
    std::erase_if(ids, [&](std::uint32_t id) { return !condition(motion, id); });
    return ids;
  };
}
/// Others in each frame.
Who some(float share) {
  return [=](const Motion& motion, Random& random) {
    Ids ids = all(motion, random);
    const std::size_t wanted = part_of(ids.size(), share);
    for (std::size_t k = 0; k < wanted; ++k) {
      std::swap(ids[k], ids[k + random.index(static_cast<std::uint32_t>(ids.size() - k))]);
    }
    ids.resize(wanted);
    return ids;
  };
}
/// The same ones in each frame.
Who one_in(std::uint32_t n) {
  return those([=](const Motion& /*motion*/, std::uint32_t id) { return id % n == 0; });
}
/// Others in each frame, of blocks of ids.
Who some_blocks(std::uint32_t size, float share) {
  return [=](const Motion& motion, Random& random) {
    Ids ids;
    for (std::uint32_t first = 0; first < motion.count(); first += size) {
      if (random.uniform(0, 1) >= share) continue;
      for (std::uint32_t id = first; id < std::min(first + size, motion.count()); ++id) ids.push_back(id);
    }
    return ids;
  };
}
const Who movers = those([](const Motion& motion, std::uint32_t id) { return !motion.steps[id].isZero(); });
/// Those in a slab that passes through the scene.
const Who in_wave = those([](const Motion& motion, std::uint32_t id) {
  const float x = centre(motion.boxes[id]).x() - static_cast<float>(motion.frame % 50) / 50;
  return x >= 0 && x < 0.05F;
});
/// Those in some of 64 regions, which wake for ten frames.
const Who awake = those([](const Motion& motion, std::uint32_t id) {
  const Eigen::Vector3i cell = (centre(motion.boxes[id]) * 4).cast<int>();
  const auto number = static_cast<std::uint32_t>(cell.x() + 4 * cell.y() + 16 * cell.z());
  return (number + motion.frame / 10 * 7) % 16 == 0;
});

// How.

Vector3f reflected(Vector3f at, Vector3f& step) {
  for (int axis = 0; axis < 3; ++axis) {
    if (at[axis] >= 0 && at[axis] <= 1) continue;
    at[axis] = at[axis] < 0 ? -at[axis] : 2 - at[axis];
    step[axis] = -step[axis];
  }
  return at;
}
void drift(Motion& motion, std::uint32_t id) {
  const Aabb& box = motion.boxes[id];
  motion.move(id, moved_to(box, reflected(centre(box) + motion.steps[id], motion.steps[id])));
}
void leap(Motion& motion, std::uint32_t id) {
  motion.move(id, moved_to(motion.boxes[id], motion.random.vector(0, 1)));
}
void nudge(Motion& motion, std::uint32_t id) {
  const Vector3f by = motion.random.vector(-motion.edge, motion.edge) / 2;
  motion.move(id, moved_to(motion.boxes[id], centre(motion.boxes[id]) + by));
}
void exchange(Motion& motion, std::uint32_t id) {
  const std::uint32_t other = motion.random.index(motion.count());
  const Aabb box = motion.boxes[id];
  motion.move(id, motion.boxes[other]);
  motion.move(other, box);
}
void appear_or_vanish(Motion& motion, std::uint32_t id) {
  const bool appears = is_empty(motion.boxes[id]);
  motion.move(id, appears ? cube_at(motion.random.vector(0, 1), motion.edge) : empty_aabb());
}
/// From a tenth of the edge of a cube to ten times.
void swell(Motion& motion, std::uint32_t id) {
  const float power = std::sin(static_cast<float>(motion.frame + id) / 8);
  motion.move(id, cube_at(centre(motion.boxes[id]), motion.edge * std::pow(10.0F, power)));
}
/// Falls to the floor, and is put back to the top.
void fall(Motion& motion, std::uint32_t id) {
  Vector3f at = centre(motion.boxes[id]) + motion.steps[id];
  if (at.y() < 0) at = {motion.random.uniform(0, 1), at.y() + 1, motion.random.uniform(0, 1)};
  motion.move(id, moved_to(motion.boxes[id], at));
}
/// What leaves the scene on one side comes back on the other.
void stream(Motion& motion, std::uint32_t id) {
  Vector3f at = centre(motion.boxes[id]) + motion.steps[id];
  at -= at.array().floor().matrix();
  motion.move(id, moved_to(motion.boxes[id], at));
}
/// The box is around the whole path of a frame.
void shoot(Motion& motion, std::uint32_t id) {
  Vector3f& step = motion.steps[id];
  const Vector3f from = centre(motion.boxes[id]) + step / 2;
  (void)reflected(from + step, step);
  const Vector3f size = step.cwiseAbs() / 2 + Vector3f::Constant(motion.edge / 2);
  motion.move(id, box_at(from + step / 2, size));
}
/// Away from the centre of the scene, or towards it.
How scale(const std::function<float(float time)>& factor) {
  return [=](Motion& motion, std::uint32_t id) {
    const float time = motion.edge * static_cast<float>(motion.frame);
    const Vector3f at = centre(motion.boxes[id]) - middle;
    motion.move(id, moved_to(motion.boxes[id], middle + at * (factor(time) / factor(time - motion.edge))));
  };
}
/// In the middle, where each overlaps all others.
void meet(Motion& motion, std::uint32_t id) {
  const Vector3f by = motion.random.vector(-motion.edge, motion.edge) / 4;
  motion.move(id, moved_to(motion.boxes[id], middle + by));
}
void spin(Motion& motion, std::uint32_t id) {
  const Eigen::AngleAxisf turn(motion.edge / 5, Vector3f::UnitY());
  motion.move(id, moved_to(motion.boxes[id], middle + turn * (centre(motion.boxes[id]) - middle)));
}
float height(float x, float z) {
  return 0.5F + 0.1F * std::sin(7 * x) * std::cos(5 * z) + 0.02F * std::sin(40 * x + 30 * z);
}
/// Drifts on the terrain.
void roam(Motion& motion, std::uint32_t id) {
  Vector3f at = reflected(centre(motion.boxes[id]) + motion.steps[id], motion.steps[id]);
  at.y() = height(at.x(), at.z());
  motion.move(id, moved_to(motion.boxes[id], at));
}
void remove(Motion& motion, std::uint32_t id) {
  motion.remove(id);
}

// Steps.

Step each(const Who& who, const How& how) {
  return [=](Motion& motion) {
    for (const std::uint32_t id : who(motion, motion.random)) how(motion, id);
  };
}
Step in_turn(const std::vector<Step>& steps) {
  return [=](Motion& motion) { steps[motion.frame % steps.size()](motion); };
}
Step both(const Step& first, const Step& second) {
  return [=](Motion& motion) {
    first(motion);
    second(motion);
  };
}
/// @param phase Of `period` frames, the one in which something else happens.
Step once_in(std::uint32_t period, std::uint32_t phase, const Step& then, const Step& otherwise) {
  return [=](Motion& motion) { (motion.frame % period == phase ? then : otherwise)(motion); };
}
void nothing(Motion& /*motion*/) {}
/// A share of the number of objects at first.
Step add(float share) {
  return [=](Motion& motion) {
    for (std::size_t k = part_of(motion.steps.size(), share); k > 0; --k) {
      motion.add(cube_at(motion.random.vector(0, 1), motion.edge));
    }
  };
}
Step replace(float share) {
  return [=](Motion& motion) {
    const Ids ids = some(share)(motion, motion.random);
    for (const std::uint32_t id : ids) motion.remove(id);
    for (std::size_t k = 0; k < ids.size(); ++k) motion.add(cube_at(motion.random.vector(0, 1), motion.edge));
  };
}
void permute(Motion& motion) {
  motion.random.shuffle(std::span(motion.boxes));
}
/// Some at the front end, others begin at the back, and all others get other ids.
void slide(Motion& motion) {
  const std::ptrdiff_t gone = motion.count() / 100 + motion.random.index(2);
  motion.boxes.erase(motion.boxes.begin(), motion.boxes.begin() + gone);
  while (motion.boxes.size() < motion.steps.size() - motion.frame % 3) {
    motion.boxes.push_back(cube_at(motion.random.vector(0, 1), motion.edge));
  }
}
/// What reaches the end is removed, and as much is added at the beginning.
void convey(Motion& motion) {
  std::size_t gone = 0;
  for (const std::uint32_t id : all(motion, motion.random)) {
    const Vector3f at = centre(motion.boxes[id]) + Vector3f(motion.edge / 10, 0, 0);
    if (at.x() > 1) {
      motion.remove(id);
      ++gone;
    } else {
      motion.move(id, moved_to(motion.boxes[id], at));
    }
  }
  for (; gone > 0; --gone) {
    Vector3f at = motion.random.vector(0, 1);
    at.x() = 0;
    motion.add(cube_at(at, motion.edge));
  }
}
/// Blocks of objects leap, each in one piece.
void leap_in_blocks(Motion& motion) {
  Vector3f by = Vector3f::Zero();
  for (const std::uint32_t id : some_blocks(64, 0.02F)(motion, motion.random)) {
    if (id % 64 == 0) by = motion.random.vector(0, 1) - centre(motion.boxes[id]);
    motion.move(id, moved_to(motion.boxes[id], centre(motion.boxes[id]) + by));
  }
}

// Starts.

Step each_box(const std::function<Aabb(Motion&, std::uint32_t id)>& make) {
  return [=](Motion& motion) {
    for (std::uint32_t id = 0; id < motion.count(); ++id) motion.boxes[id] = make(motion, id);
  };
}
void mixed(Motion& motion) {
  const MovingBoxes scene(motion.count(), MovingBoxes::Sizes::mixed);
  motion.boxes.assign(scene.boxes().begin(), scene.boxes().end());
}
/// Up to so many edges per frame and axis.
Step with_speed(float most) {
  return [=](Motion& motion) {
    for (Vector3f& step : motion.steps) step = motion.random.vector(-most, most) * motion.edge;
  };
}
/// Most objects rest, and are as dense as if each overlapped so many others; the last ones move.
/// @param filters Whether those that rest refuse each other, as Bullet's static objects do.
Step level(float resting, float overlaps, bool filters) {
  return [=](Motion& motion) {
    const float count = std::floor(resting * static_cast<float>(motion.count()));
    const float edge = std::cbrt(std::min(overlaps, count / 4) / count) / 2;
    for (std::uint32_t id = 0; static_cast<float>(id) < count; ++id) {
      const Vector3f size = motion.random.vector(0.5F, 1.5F) * edge;
      motion.boxes[id] = box_at(motion.random.vector(0, 1), size / 2);
      motion.steps[id].setZero();
      if (filters) motion.filters[id] = {.group = 2, .mask = ~2U};
    }
  };
}
/// Triangles of a height field, two per cell; what is left moves on it.
Step terrain(float resting) {
  return [=](Motion& motion) {
    const auto cells =
        static_cast<std::uint32_t>(std::sqrt(resting / 2 * static_cast<float>(motion.count())));
    const float size = 1 / static_cast<float>(cells);
    for (std::uint32_t id = 0; id < motion.count(); ++id) {
      const Vector3f at = motion.random.vector(0, 1);
      motion.boxes[id] = cube_at({at.x(), height(at.x(), at.z()), at.z()}, size);
      motion.steps[id] = motion.steps[id].cwiseProduct(Vector3f(1, 0, 1)).normalized() * size / 10;
    }
    for (std::uint32_t id = 0; id < 2 * cells * cells; ++id) {
      const std::uint32_t cell = id / 2;
      const std::uint32_t row = cell / cells;
      const float x = static_cast<float>(cell % cells) * size;
      const float z = static_cast<float>(row) * size;
      Eigen::AlignedBox3f bounds;
      for (const auto& [dx, dz] :
           {std::pair(0.0F, 0.0F), {size, size}, {id % 2 == 0 ? size : 0, id % 2 == 0 ? 0 : size}}) {
        bounds.extend(Vector3f(x + dx, height(x + dx, z + dz), z + dz));
      }
      motion.boxes[id] = box_at(bounds.center(), bounds.sizes() / 2);
      motion.steps[id].setZero();
      motion.filters[id] = {.group = 2, .mask = ~2U};
    }
  };
}
/// Drops, and a few triggers, which rest.
void rain(Motion& motion) {
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    motion.steps[id] = {0, -motion.edge * motion.random.uniform(0.1F, 0.3F), 0};
    if (id % 1000 != 7) continue;
    motion.boxes[id] = cube_at(centre(motion.boxes[id]), 0.2F);
    motion.steps[id].setZero();
  }
}
void two_streams(Motion& motion) {
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    motion.steps[id] = {(id % 2 == 0 ? 0.2F : -0.2F) * motion.edge, 0, 0};
  }
}
/// Worlds of 64 objects in the same place.
void worlds(Motion& motion) {
  motion.edge = MovingBoxes(64, MovingBoxes::Sizes::uniform).edge();
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    motion.boxes[id] = cube_at(centre(motion.boxes[id]), motion.edge);
    motion.steps[id] = motion.steps[id].normalized() * motion.edge / 10;
    motion.filters[id].world = id / 64;
  }
}
void two_sets(Motion& motion) {
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    motion.filters[id] = id % 2 == 0 ? Filter::first_set : Filter::second_set;
  }
}
/// Long boxes in three directions, each of which meets about six.
Aabb cable(Motion& motion, std::uint32_t id) {
  const float length = std::min(20 * motion.edge, 0.5F);
  Vector3f size = Vector3f::Constant(4.5F / (static_cast<float>(motion.count()) * length * length));
  size[id % 3] = length;
  return box_at(motion.random.vector(0, 1), size / 2);
}
/// In one plane, each meets about four others.
Aabb in_plane(Motion& motion, std::uint32_t id) {
  const float edge = std::sqrt(1 / static_cast<float>(motion.count()));
  motion.steps[id] = motion.steps[id].cwiseProduct(Vector3f(1, 1, 0)).normalized() * edge / 10;
  Vector3f at = motion.random.vector(0, 1);
  at.z() = 0;
  return box_at(at, Vector3f(edge / 2, edge / 2, 0));
}
/// Boxes of a block beside each other.
Aabb cluster(Motion& motion, std::uint32_t id) {
  const Vector3f at = id % 64 == 0 ? motion.random.vector(0, 1) : centre(motion.boxes[id - id % 64]);
  return cube_at(at + motion.random.vector(-2, 2) * motion.edge, motion.edge);
}
void bullets(Motion& motion) {
  for (std::uint32_t id = 0; id < motion.count(); id += 100) motion.steps[id] *= 200;
}
void flyer(Motion& motion) {
  for (Vector3f& step : motion.steps) step.setZero();
  motion.steps[0] = Vector3f(2, 0.3F, 0.1F) * motion.edge;
}

}  // namespace

std::span<const MotionInfo> motions() {
  const Step all_drift = each(all, drift);
  const How apart = scale([](float time) { return 1 + time; });
  const How together = scale([](float time) { return 0.7F + 2.3F * std::exp(-time); });
  static const std::vector<MotionInfo> rows{
      {"tremble", nothing, all_drift},
      {"tremble-mixed", mixed, all_drift},
      {"tremble-0.1%", nothing, each(one_in(1000), drift)},
      {"tremble-1%", nothing, each(one_in(100), drift)},
      {"tremble-1%-others", nothing, each(some(0.01F), drift)},
      {"teleport-0.1%", nothing, each(some(0.001F), leap)},
      {"teleport-1%", nothing, each(some(0.01F), leap)},
      {"teleport-5%", nothing, each(some(0.05F), leap)},
      {"teleport-1%-among-trembling", nothing, both(all_drift, each(some(0.01F), leap))},
      {"leap-1%", nothing, each(some(0.01F), leap), true},
      {"leap-10%", nothing, each(some(0.1F), leap), true},
      {"leap-100%", nothing, each(all, leap), true},
      {"level", level(0.92F, 2400, true), each(movers, drift)},
      {"level-unfiltered", level(0.92F, 100, false), each(movers, drift)},
      {"level-90%", level(0.9F, 150, true), each(movers, drift)},
      {"terrain", terrain(0.92F), each(movers, roam)},
      {"permute", nothing, both(all_drift, permute), true},
      {"permute-some", nothing, both(all_drift, each(some(0.02F), exchange)), true},
      {"speed-4", with_speed(4), all_drift},
      {"speed-2", with_speed(2), all_drift},
      {"speed-0.6", with_speed(0.6F), all_drift},
      {"speed-0.3", with_speed(0.3F), all_drift},
      {"replace-10%", nothing, replace(0.1F)},
      {"replace-1%", nothing, replace(0.01F)},
      {"come-or-go-1%", nothing, in_turn({add(0.01F), each(some(0.01F), remove)})},
      {"come-1%", nothing, add(0.01F)},
      {"go-1%", nothing, each(some(0.01F), remove)},
      {"thinned", nothing, once_in(~0U, 2, each(some(0.9F), remove), all_drift)},
      {"unload", nothing, once_in(20, 5, each(some(0.5F), remove), once_in(20, 15, add(0.5F), all_drift))},
      {"explode", nothing, each(all, apart)},
      {"collapse", each_box([](Motion& m, auto id) {
         return moved_to(m.boxes[id], middle + 3 * (centre(m.boxes[id]) - middle));
       }),
       each(all, together)},
      {"spin", nothing, each(all, spin)},
      {"rain", rain, each(movers, fall)},
      {"streams", two_streams, each(all, stream)},
      {"worlds", worlds, both(all_drift, each(some_blocks(64, 0.01F), leap))},
      {"two-sets", two_sets, both(all_drift, each(some(0.01F), leap))},
      {"flyer", flyer, each(movers, drift)},
      {"bullets", bullets, both(each(one_in(100), shoot), each(some(0.1F), drift))},
      {"giant", [](Motion& m) { m.boxes[0] = cube_at(middle, 1); }, all_drift},
      {"cables", each_box(cable), all_drift},
      {"flat", each_box(in_plane), all_drift},
      {"swell", nothing, both(all_drift, each(one_in(100), swell))},
      {"cut", nothing, once_in(50, 25, each(all, leap), all_drift)},
      {"pause", nothing, once_in(10, 9, all_drift, nothing)},
      {"wave", nothing, each(in_wave, drift)},
      {"awake", nothing, each(awake, drift)},
      {"monte-carlo", nothing, each(some(0.001F), nudge)},
      {"blocks", each_box(cluster), leap_in_blocks},
      {"conveyor", nothing, convey},
      {"slide", nothing, slide, true},
      {"blink", nothing, each(some(0.01F), appear_or_vanish)},
      {"one-place", nothing, each(all, meet)},
  };
  return rows;
}

Motion::Motion(const MotionInfo& info, std::uint32_t count, std::uint64_t seed)
    : filters(count), random(seed), info_(info) {
  const MovingBoxes scene(count, MovingBoxes::Sizes::uniform, seed);
  edge = scene.edge();
  boxes.assign(scene.boxes().begin(), scene.boxes().end());
  for (std::uint32_t id = 0; id < count; ++id)
    steps.emplace_back(random.vector(-1, 1).normalized() * edge / 10);
  info_.start(*this);
}

MotionFrame Motion::next() {
  if (frame++ == 0) return {.added = boxes, .filters = filters};
  removed_.clear();
  added_.clear();
  moved_.clear();
  info_.step(*this);
  if (info_.whole) return {.boxes = boxes, .whole = true};
  MotionFrame result{.removed = std::move(removed_), .moved = std::move(moved_)};
  for (Ids* ids : {&result.removed, &result.moved}) {
    std::ranges::sort(*ids);
    ids->erase(std::unique(ids->begin(), ids->end()), ids->end());
  }
  std::erase_if(result.moved, [&](std::uint32_t id) { return !contains(id); });
  for (const std::uint32_t id : added_) {
    result.added.push_back(boxes[id]);
    result.filters.push_back(filters[id]);
  }
  for (const std::uint32_t id : result.moved) result.boxes.push_back(boxes[id]);
  return result;
}

std::vector<Aabb> Motion::present() const {
  std::vector<Aabb> result;
  for (std::uint32_t id = 0; id < count(); ++id) {
    if (contains(id)) result.push_back(boxes[id]);
  }
  return result;
}

void Motion::move(std::uint32_t id, const Aabb& box) {
  boxes[id] = box;
  moved_.push_back(id);
}

void Motion::remove(std::uint32_t id) {
  free_.insert(id);
  removed_.push_back(id);
}

void Motion::add(const Aabb& box) {
  std::uint32_t id = count();
  if (free_.empty()) {
    boxes.push_back(box);
    filters.emplace_back();
  } else {
    id = free_.extract(free_.begin()).value();
    boxes[id] = box;
  }
  added_.push_back(id);
}

}  // namespace broadcl::scenes
