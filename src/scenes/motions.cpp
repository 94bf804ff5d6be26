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
using Who = std::function<Ids(Motion&)>;
using How = std::function<void(Motion&, std::uint32_t id)>;

const Vector3f middle = Vector3f::Constant(0.5F);

Vector3f corner(const std::array<float, 3>& corner) {
  return {corner[0], corner[1], corner[2]};
}
Vector3f centre(const Aabb& box) {
  return (corner(box.lower) + corner(box.upper)) / 2;
}
Aabb box_at(const Vector3f& at, const Vector3f& size) {
  const Vector3f lower = at - size / 2;
  const Vector3f upper = at + size / 2;
  return {{lower.x(), lower.y(), lower.z()}, {upper.x(), upper.y(), upper.z()}};
}
Aabb cube_at(const Vector3f& at, float edge) {
  return box_at(at, Vector3f::Constant(edge));
}
Vector3f anywhere(Motion& motion) {
  return motion.random.vector(0, 1);
}
std::size_t part_of(std::size_t n, float share) {
  return static_cast<std::size_t>(std::ceil(share * static_cast<float>(n)));
}

// Who.

Ids all(Motion& motion) {
  Ids ids;
  for (std::uint32_t id = 0; id < motion.count(); ++id) {
    if (motion.contains(id)) ids.push_back(id);
  }
  return ids;
}
Who those(const std::function<bool(Motion&, std::uint32_t)>& condition) {
  return [=](Motion& motion) {
    Ids ids = all(motion);
    std::erase_if(ids, [&](std::uint32_t id) { return !condition(motion, id); });
    return ids;
  };
}
/// Others in each frame.
Who some(float share) {
  return [=](Motion& motion) {
    Ids ids = all(motion);
    const std::size_t wanted = part_of(ids.size(), share);
    for (std::size_t k = 0; k < wanted; ++k) {
      std::swap(ids[k], ids[k + motion.random.index(static_cast<std::uint32_t>(ids.size() - k))]);
    }
    ids.resize(wanted);
    return ids;
  };
}
/// The same ones in each frame.
Who one_in(std::uint32_t n) {
  return those([=](Motion& /*motion*/, std::uint32_t id) { return id % n == 0; });
}
/// Others in each frame, of blocks of 64 ids.
Who some_blocks(float share) {
  return [=](Motion& motion) {
    bool is_chosen = false;
    return those([&](Motion& /*motion*/, std::uint32_t id) {
      if (id % 64 == 0) is_chosen = motion.random.uniform(0, 1) < share;
      return is_chosen;
    })(motion);
  };
}
const Who movers = those([](Motion& motion, std::uint32_t id) { return !motion.steps[id].isZero(); });
/// Those in a slab that passes through the scene.
const Who in_wave = those([](Motion& motion, std::uint32_t id) {
  const float x = centre(motion.boxes[id]).x() - static_cast<float>(motion.frame % 50) / 50;
  return x >= 0 && x < 0.05F;
});
/// Those in some of 64 regions, which wake for ten frames.
const Who awake = those([](Motion& motion, std::uint32_t id) {
  const Eigen::Vector3i cell = (centre(motion.boxes[id]) * 4).cast<int>();
  const auto number = static_cast<std::uint32_t>(cell.x() + 4 * cell.y() + 16 * cell.z());
  return (number + motion.frame / 10 * 7) % 16 == 0;
});

// How.

void put(Motion& motion, std::uint32_t id, const Vector3f& at) {
  const Aabb& box = motion.boxes[id];
  motion.move(id, box_at(at, corner(box.upper) - corner(box.lower)));
}
void shift(Motion& motion, std::uint32_t id, const Vector3f& by) {
  put(motion, id, centre(motion.boxes[id]) + by);
}
Vector3f reflected(Vector3f at, Vector3f& step) {
  for (int axis = 0; axis < 3; ++axis) {
    if (at[axis] >= 0 && at[axis] <= 1) continue;
    at[axis] = at[axis] < 0 ? -at[axis] : 2 - at[axis];
    step[axis] = -step[axis];
  }
  return at;
}
void drift(Motion& motion, std::uint32_t id) {
  Vector3f& step = motion.steps[id];
  put(motion, id, reflected(centre(motion.boxes[id]) + step, step));
}
void leap(Motion& motion, std::uint32_t id) {
  put(motion, id, anywhere(motion));
}
void nudge(Motion& motion, std::uint32_t id) {
  shift(motion, id, motion.random.vector(-motion.edge, motion.edge) / 2);
}
void exchange(Motion& motion, std::uint32_t id) {
  std::swap(motion.boxes[id], motion.boxes[motion.random.index(motion.count())]);
}
void appear_or_vanish(Motion& motion, std::uint32_t id) {
  const bool appears = is_empty(motion.boxes[id]);
  motion.move(id, appears ? cube_at(anywhere(motion), motion.edge) : empty_aabb());
}
/// From a tenth of the edge of a cube to ten times.
void swell(Motion& motion, std::uint32_t id) {
  const float power = std::sin(static_cast<float>(motion.frame + id) / 8);
  motion.move(id, cube_at(centre(motion.boxes[id]), motion.edge * std::pow(10.0F, power)));
}
/// Falls to the floor, and is put back to the top.
void fall(Motion& motion, std::uint32_t id) {
  const Vector3f at = centre(motion.boxes[id]) + motion.steps[id];
  const Vector3f top = anywhere(motion);
  put(motion, id, at.y() >= 0 ? at : Vector3f(top.x(), 1, top.z()));
}
/// What leaves the scene on one side comes back on the other.
void stream(Motion& motion, std::uint32_t id) {
  const Vector3f at = centre(motion.boxes[id]) + motion.steps[id];
  put(motion, id, at.array() - at.array().floor());
}
/// The box is around the whole path of a frame.
void shoot(Motion& motion, std::uint32_t id) {
  Vector3f& step = motion.steps[id];
  const Vector3f from = centre(motion.boxes[id]) + step / 2;
  (void)reflected(from + step, step);
  motion.move(id, box_at(from + step / 2, step.cwiseAbs().array() + motion.edge));
}
/// Away from the centre of the scene, or towards it.
How scale(const std::function<float(float frame)>& factor) {
  return [=](Motion& motion, std::uint32_t id) {
    const auto frame = static_cast<float>(motion.frame);
    const float by = factor(frame) / factor(frame - 1);
    put(motion, id, middle + (centre(motion.boxes[id]) - middle) * by);
  };
}
void spin(Motion& motion, std::uint32_t id) {
  const Eigen::AngleAxisf turn(motion.edge / 5, Vector3f::UnitY());
  put(motion, id, middle + turn * (centre(motion.boxes[id]) - middle));
}
/// In the middle, where each overlaps all others.
void meet(Motion& motion, std::uint32_t id) {
  put(motion, id, middle + motion.random.vector(-motion.edge, motion.edge) / 4);
}
float height(float x, float z) {
  return 0.5F + 0.1F * std::sin(7 * x) * std::cos(5 * z) + 0.02F * std::sin(40 * x + 30 * z);
}
/// Drifts on the terrain.
void roam(Motion& motion, std::uint32_t id) {
  drift(motion, id);
  const Vector3f at = centre(motion.boxes[id]);
  put(motion, id, {at.x(), height(at.x(), at.z()), at.z()});
}
void remove(Motion& motion, std::uint32_t id) {
  motion.remove(id);
}

// Steps.

Step each(const Who& who, const How& how) {
  return [=](Motion& motion) {
    for (const std::uint32_t id : who(motion)) how(motion, id);
  };
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
      motion.add(cube_at(anywhere(motion), motion.edge));
    }
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
    motion.boxes.push_back(cube_at(anywhere(motion), motion.edge));
  }
}
/// What reaches the end is removed, and as much is added at the beginning.
void convey(Motion& motion) {
  std::size_t gone = 0;
  for (const std::uint32_t id : all(motion)) {
    shift(motion, id, {motion.edge / 10, 0, 0});
    if (centre(motion.boxes[id]).x() <= 1) continue;
    motion.remove(id);
    ++gone;
  }
  for (; gone > 0; --gone) motion.add(cube_at(anywhere(motion).cwiseProduct(Vector3f(0, 1, 1)), motion.edge));
}
/// Blocks of objects leap, each in one piece.
void leap_in_blocks(Motion& motion) {
  Vector3f by = Vector3f::Zero();
  for (const std::uint32_t id : some_blocks(0.02F)(motion)) {
    if (id % 64 == 0) by = anywhere(motion) - centre(motion.boxes[id]);
    shift(motion, id, by);
  }
}

// Starts.

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
      motion.boxes[id] = box_at(anywhere(motion), size);
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
      const Vector3f at = anywhere(motion);
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
      motion.boxes[id] = box_at(bounds.center(), bounds.sizes());
      motion.steps[id].setZero();
      motion.filters[id] = {.group = 2, .mask = ~2U};
    }
  };
}
/// Up to 2,000 cubes, and below them a plain of boxes that rest, eight times as wide and with gaps between
/// them, which goes far beyond the scene.
void plain(Motion& motion) {
  const std::uint32_t moving = std::min(motion.count() / 6, 2000U);
  const std::uint32_t resting = motion.count() - moving;
  const MovingBoxes scene(moving, MovingBoxes::Sizes::uniform);
  motion.edge = scene.edge();
  std::ranges::copy(scene.boxes(), motion.boxes.begin() + resting);
  for (Vector3f& step : motion.steps) step = step.normalized() * motion.edge / 10;
  const auto row = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<float>(resting))));
  const float half = static_cast<float>(row) / 2;
  for (std::uint32_t id = 0; id < resting; ++id) {
    const std::uint32_t column = id / row;
    const Vector3f cell(static_cast<float>(column) - half, 0, static_cast<float>(id % row) - half);
    motion.boxes[id] = box_at(cell * 10 * motion.edge, Vector3f(8, 1, 8) * motion.edge);
    motion.steps[id].setZero();
    motion.filters[id] = {.group = 2, .mask = ~2U};
  }
}
/// Drops, and a few triggers, which rest.
void rain(Motion& motion, std::uint32_t id) {
  motion.steps[id] = {0, -motion.edge * motion.random.uniform(0.1F, 0.3F), 0};
  if (id % (motion.count() / 10 + 1) != 7) return;
  motion.boxes[id] = cube_at(centre(motion.boxes[id]), 0.2F);
  motion.steps[id].setZero();
}
void two_streams(Motion& motion, std::uint32_t id) {
  motion.steps[id] = {(id % 2 == 0 ? 0.2F : -0.2F) * motion.edge, 0, 0};
}
/// Worlds of 64 objects in the same place.
void worlds(Motion& motion, std::uint32_t id) {
  if (id == 0) motion.edge = MovingBoxes(64, MovingBoxes::Sizes::uniform).edge();
  motion.boxes[id] = cube_at(centre(motion.boxes[id]), motion.edge);
  motion.steps[id] = motion.steps[id].normalized() * motion.edge / 10;
  motion.filters[id].world = id / 64;
}
void two_sets(Motion& motion, std::uint32_t id) {
  motion.filters[id] = id % 2 == 0 ? Filter::first_set : Filter::second_set;
}
void far_out(Motion& motion, std::uint32_t id) {
  put(motion, id, middle + 3 * (centre(motion.boxes[id]) - middle));
}
/// Long boxes in three directions, each of which meets about six.
void cable(Motion& motion, std::uint32_t id) {
  const float length = std::min(20 * motion.edge, 0.5F);
  Vector3f size = Vector3f::Constant(4.5F / (static_cast<float>(motion.count()) * length * length));
  size[id % 3] = length;
  motion.boxes[id] = box_at(anywhere(motion), size);
}
/// In one plane, each meets about four others.
void flat_box(Motion& motion, std::uint32_t id) {
  const float edge = std::sqrt(1 / static_cast<float>(motion.count()));
  motion.steps[id] = motion.steps[id].cwiseProduct(Vector3f(1, 1, 0)).normalized() * edge / 10;
  motion.boxes[id] = box_at(anywhere(motion).cwiseProduct(Vector3f(1, 1, 0)), {edge, edge, 0});
}
/// Beside the others of a block.
void cluster(Motion& motion, std::uint32_t id) {
  if (id % 64 != 0)
    put(motion, id, centre(motion.boxes[id - id % 64]) + motion.random.vector(-2, 2) * motion.edge);
}
void flyer(Motion& motion) {
  for (Vector3f& step : motion.steps) step.setZero();
  motion.steps[0] = Vector3f(2, 0.3F, 0.1F) * motion.edge;
}

}  // namespace

std::span<const MotionInfo> motions() {
  const Step all_drift = each(all, drift);
  const How apart = scale([](float frame) { return 1 + frame / 200; });
  const How together = scale([](float frame) { return 0.7F + 2.3F * std::exp(-frame / 100); });
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
      {"plain", plain, each(movers, drift)},
      {"permute", nothing, both(all_drift, permute), true},
      {"permute-some", nothing, both(all_drift, each(some(0.02F), exchange)), true},
      {"speed-4", with_speed(4), all_drift},
      {"speed-2", with_speed(2), all_drift},
      {"speed-0.6", with_speed(0.6F), all_drift},
      {"speed-0.3", with_speed(0.3F), all_drift},
      {"replace-10%", nothing, both(each(some(0.1F), remove), add(0.1F))},
      {"replace-1%", nothing, both(each(some(0.01F), remove), add(0.01F))},
      {"come-or-go-1%", nothing, once_in(2, 0, add(0.01F), each(some(0.01F), remove))},
      {"come-1%", nothing, add(0.01F)},
      {"go-1%", nothing, each(some(0.01F), remove)},
      {"thinned", nothing, once_in(~0U, 2, each(some(0.9F), remove), all_drift)},
      {"unload", nothing, once_in(20, 5, each(some(0.5F), remove), once_in(20, 15, add(0.5F), all_drift))},
      {"explode", nothing, each(all, apart)},
      {"collapse", each(all, far_out), each(all, together)},
      {"spin", nothing, each(all, spin)},
      {"rain", each(all, rain), each(movers, fall)},
      {"streams", each(all, two_streams), each(all, stream)},
      {"worlds", each(all, worlds), both(all_drift, each(some_blocks(0.01F), leap))},
      {"two-sets", each(all, two_sets), both(all_drift, each(some(0.01F), leap))},
      {"flyer", flyer, each(movers, drift)},
      {"bullets", each(one_in(100), [](Motion& m, auto id) { m.steps[id] *= 200; }),
       both(each(one_in(100), shoot), each(some(0.1F), drift))},
      {"giant", [](Motion& m) { m.boxes[0] = cube_at(middle, 1); }, all_drift},
      {"cables", each(all, cable), all_drift},
      {"flat", each(all, flat_box), all_drift},
      {"swell", nothing, both(all_drift, each(one_in(100), swell))},
      {"cut", nothing, once_in(50, 25, each(all, leap), all_drift)},
      {"pause", nothing, once_in(10, 9, all_drift, nothing)},
      {"wave", nothing, each(in_wave, drift)},
      {"awake", nothing, each(awake, drift)},
      {"monte-carlo", nothing, each(some(0.001F), nudge)},
      {"blocks", each(all, cluster), leap_in_blocks},
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
