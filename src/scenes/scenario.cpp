#include "scenes/scenario.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <broadcl/error.hpp>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <optional>

namespace broadcl::scenes {
namespace {

constexpr float earth_gravity = 9.798F;
constexpr float top_speed = 10;  // of each component
constexpr std::uint32_t kicks_per_frame = 25;
constexpr double rotation_per_frame = 1.0 / 120;
constexpr double exchanged_per_second = 0.05;  // of all objects

constexpr std::array<SizeClass, 1> equal_sizes{{{1, 1}}};

struct Rules {
  ScenarioInfo info;
  std::span<const SizeClass> sizes;  // smallest first
  float gravity;
  bool agitates;
  bool rotates;
  bool streams = false;
};

constexpr std::array rules{
    Rules{.info = {.name = "free-fall", .summary = "objects fall and come to rest on the floor"},
          .sizes = equal_sizes,
          .gravity = earth_gravity,
          .agitates = false,
          .rotates = false},
    Rules{.info = {.name = "agitated",
                   .summary = "free-fall, but 25 objects per frame get a new random velocity"},
          .sizes = equal_sizes,
          .gravity = earth_gravity,
          .agitates = true,
          .rotates = false},
    Rules{.info = {.name = "rolling-gravity",
                   .summary = "strong, rotating gravity throws all objects from face to face"},
          .sizes = equal_sizes,
          .gravity = 50 * earth_gravity,
          .agitates = false,
          .rotates = true},
    Rules{.info = {.name = "mixed-sizes",
                   .summary = "rolling-gravity with small, average and large objects, a third each"},
          .sizes = mixed_sizes,
          .gravity = 50 * earth_gravity,
          .agitates = false,
          .rotates = true},
    Rules{.info = {.name = "streaming",
                   .summary =
                       "free-fall, but every second 5 % of the objects leave and as many come in on top"},
          .sizes = equal_sizes,
          .gravity = earth_gravity,
          .agitates = false,
          .rotates = false,
          .streams = true},
};

constexpr auto infos = [] {
  std::array<ScenarioInfo, rules.size()> result{};
  for (std::size_t k = 0; k < rules.size(); ++k) result[k] = rules[k].info;
  return result;
}();

const Rules& find_rules(std::string_view name) {
  const auto* row =
      std::find_if(rules.begin(), rules.end(), [&](const auto& r) { return r.info.name == name; });
  if (row != rules.end()) return *row;
  std::string names;
  for (const Rules& r : rules) names += (names.empty() ? "" : ", ") + std::string(r.info.name);
  throw Error("no scenario is named '" + std::string(name) + "'; the scenarios are: " + names);
}

/// Twice the edge of a cube whose volume is the expected volume of all objects together.
float container_edge_for(std::span<const SizeClass> sizes, std::uint32_t objects) {
  double mean_volume = 0;
  for (const auto [lower, upper] : sizes) {
    const auto a = static_cast<double>(lower);
    const auto b = static_cast<double>(upper);
    mean_volume += (a + b) * (a * a + b * b) / 4 / static_cast<double>(sizes.size());
  }
  return static_cast<float>(2 * std::cbrt(objects * mean_volume));
}

/// Cubic cells that fill the container. Each cell contains at most one object, which lies inside it.
class Lattice {
 public:
  Lattice(float container_edge, std::uint32_t cells_per_axis)
      : container_edge_(container_edge),
        cells_per_axis_(cells_per_axis),
        boxes_(std::size_t{cells_per_axis} * cells_per_axis * cells_per_axis) {}

  [[nodiscard]] std::size_t size() const { return boxes_.size(); }

  [[nodiscard]] float cell_edge() const { return container_edge_ / static_cast<float>(cells_per_axis_); }

  [[nodiscard]] Eigen::Vector3f lower_corner(std::uint32_t cell) const {
    const std::uint32_t x = cell % cells_per_axis_;
    const std::uint32_t y = cell / cells_per_axis_ % cells_per_axis_;
    const std::uint32_t z = cell / cells_per_axis_ / cells_per_axis_;
    const Eigen::Vector3f position = Eigen::Matrix<std::uint32_t, 3, 1>(x, y, z).cast<float>();
    return (position * cell_edge()).array() - container_edge_ / 2;
  }

  void occupy(std::uint32_t cell, const Eigen::AlignedBox3f& box) { boxes_[cell] = box; }

  [[nodiscard]] bool intersects(const Eigen::AlignedBox3f& box) const {
    const Eigen::Array3i first = cell_at(box.min());
    const Eigen::Array3i last = cell_at(box.max());
    const auto n = static_cast<int>(cells_per_axis_);
    for (int z = first.z(); z <= last.z(); ++z) {
      for (int y = first.y(); y <= last.y(); ++y) {
        for (int x = first.x(); x <= last.x(); ++x) {
          const int cell = (z * n + y) * n + x;
          if (boxes_[static_cast<std::size_t>(cell)].intersects(box)) return true;
        }
      }
    }
    return false;
  }

 private:
  [[nodiscard]] Eigen::Array3i cell_at(const Eigen::Vector3f& point) const {
    const Eigen::Array3f cell = (point.array() + container_edge_ / 2) / cell_edge();
    return cell.cast<int>().max(0).min(static_cast<int>(cells_per_axis_) - 1);
  }

  float container_edge_;
  std::uint32_t cells_per_axis_;
  std::vector<Eigen::AlignedBox3f> boxes_;  // empty in a free cell
};

/// Places the objects of a scenario class by class, each class on a separate lattice.
class Placement {
 public:
  Placement(float container_edge, Random& random) : container_edge_(container_edge), random_(random) {}

  /// To be called with the largest class first. False if an object does not fit; the placement is then
  /// useless.
  [[nodiscard]] bool add(const SizeClass& sizes, std::uint32_t count) {
    if (count == 0) return true;
    Lattice lattice(container_edge_, cells_per_axis(sizes, count));
    std::vector<std::uint32_t> cells(lattice.size());
    std::iota(cells.begin(), cells.end(), 0U);
    random_.shuffle(std::span(cells));

    auto next = cells.begin();
    for (std::uint32_t k = 0; k < count; ++k) {
      const float edge = random_.uniform(sizes.lower, sizes.upper);
      const float slack = lattice.cell_edge() - edge - clearance;
      if (slack < 0) return false;
      for (bool placed = false; !placed; ++next) {
        if (next == cells.end()) return false;
        const Eigen::Array3f lower =
            (lattice.lower_corner(*next) + random_.vector(0, slack)).array() + clearance / 2;
        const Eigen::AlignedBox3f box(lower, lower + edge);
        placed = is_free(box);
        if (!placed) continue;
        lattice.occupy(*next, box);
        objects_.push_back({.position = box.center(), .velocity = Eigen::Vector3f::Zero(), .edge = edge});
      }
    }
    lattices_.push_back(std::move(lattice));
    return true;
  }

  [[nodiscard]] std::vector<Scenario::Object>& objects() { return objects_; }

 private:
  static constexpr float clearance = 0.01F;  // between objects; far above rounding errors

  [[nodiscard]] std::uint32_t cells_per_axis(const SizeClass& sizes, std::uint32_t count) const {
    const auto fits = static_cast<std::uint32_t>(container_edge_ / (sizes.upper + clearance));
    const std::uint64_t wanted =
        lattices_.empty() ? count : std::uint64_t{8} * count;  // spare cells, to avoid larger objects
    std::uint32_t cells = 1;
    while (std::uint64_t{cells} * cells * cells < wanted) ++cells;
    return lattices_.empty() ? cells : std::clamp(fits, 1U, cells);
  }

  [[nodiscard]] bool is_free(const Eigen::AlignedBox3f& box) const {
    const Eigen::Array3f margin = Eigen::Array3f::Constant(clearance);
    const Eigen::AlignedBox3f enlarged(box.min().array() - margin, box.max().array() + margin);
    return std::none_of(lattices_.begin(), lattices_.end(),
                        [&](const Lattice& lattice) { return lattice.intersects(enlarged); });
  }

  float container_edge_;
  Random& random_;
  std::vector<Lattice> lattices_;
  std::vector<Scenario::Object> objects_;
};

/// None if the drawn sizes do not fit next to each other, which happens with a handful of objects.
std::optional<std::vector<Scenario::Object>> try_to_place(std::span<const SizeClass> sizes,
                                                          std::uint32_t objects, float container_edge,
                                                          Random& random) {
  Placement placement(container_edge, random);
  const auto classes = static_cast<std::uint32_t>(sizes.size());
  for (std::uint32_t k = classes; k-- > 0;) {
    const std::uint32_t count = objects / classes + (k < objects % classes ? 1 : 0);
    if (!placement.add(sizes[k], count)) return std::nullopt;
  }
  return std::move(placement.objects());
}

std::vector<Scenario::Object> place(const Rules& rule, std::uint32_t objects, float container_edge,
                                    Random& random) {
  constexpr int attempts = 100;
  for (int k = 0; k < attempts; ++k) {
    if (auto placed = try_to_place(rule.sizes, objects, container_edge, random)) {
      random.shuffle(std::span(*placed));
      return std::move(*placed);
    }
  }
  throw Error("scenario '" + std::string(rule.info.name) + "' cannot place " + std::to_string(objects) +
              " objects; use another seed or more objects");
}

/// A random object that is in none of the rows.
template <class Row>
std::uint32_t draw_other(const std::vector<Row>& rows, std::uint32_t objects, Random& random) {
  for (;;) {
    const std::uint32_t object = random.index(objects);
    if (std::none_of(rows.begin(), rows.end(), [&](const Row& row) { return row.object == object; })) {
      return object;
    }
  }
}

Eigen::Vector3d rotated(const Eigen::Vector3d& v, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(rotation_per_frame, axis) * v;
}

}  // namespace

std::span<const ScenarioInfo> Scenario::list() noexcept {
  return infos;
}

Scenario::Scenario(const Config& config)
    : config_(config), random_(config.seed), axes_(Eigen::Matrix3d::Identity()) {
  const Rules& rule = find_rules(config.name);
  if (config.objects < 1 || config.objects > max_objects) {
    throw Error("a scenario takes 1 to " + std::to_string(max_objects) + " objects, not " +
                std::to_string(config.objects));
  }
  agitates_ = rule.agitates;
  rotates_ = rule.rotates;
  streams_ = rule.streams;
  gravity_ = {0, -rule.gravity, 0};
  container_edge_ = container_edge_for(rule.sizes, config.objects);
  objects_ = place(rule, config.objects, container_edge_, random_);
  for (Object& object : objects_) object.velocity = random_.vector(-top_speed, top_speed);
  if (agitates_) draw_kicks();
}

void Scenario::advance() {
  if (agitates_) draw_kicks();
  if (streams_) draw_exchanges();
  if (rotates_) {
    gravity_ = rotated(gravity_.cast<double>(), axes_.col(0)).cast<float>();
    axes_.col(0) = rotated(axes_.col(0), axes_.col(1));
    axes_.col(1) = rotated(axes_.col(1), axes_.col(2));
  }
}

void Scenario::draw_kicks() {
  kicks_.clear();
  const std::uint32_t count = std::min(kicks_per_frame, config_.objects);
  while (kicks_.size() < count) {
    const std::uint32_t object = draw_other(kicks_, config_.objects, random_);
    kicks_.push_back({.object = object, .velocity = random_.vector(-top_speed, top_speed)});
  }
}

void Scenario::draw_exchanges() {
  exchanges_.clear();
  for (due_ += config_.objects * exchanged_per_second * static_cast<double>(frame_seconds); due_ >= 1;
       --due_) {
    const std::uint32_t object = draw_other(exchanges_, config_.objects, random_);
    const float reach = (container_edge_ - objects_[object].edge) / 2;
    Eigen::Vector3f position = random_.vector(-reach, reach);
    position.y() = reach;
    exchanges_.push_back(
        {.object = object, .position = position, .velocity = random_.vector(-top_speed, top_speed)});
  }
}

}  // namespace broadcl::scenes
