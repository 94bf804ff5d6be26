#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "base/packed_box.hpp"
#include "base/threads.hpp"
#include "mpi/corners.hpp"

namespace broadcl::mpi {

/// Cells of a Grid.
inline constexpr std::size_t cell_count = 64;
/// Most objects that a rank lists by themselves.
inline constexpr std::size_t most_large = 64;

/// Boxes that together contain the boxes of all objects of a rank, for other ranks. Unused ones are
/// packed_empty().
struct Bounds {
  std::array<Aabb, cell_count> cells;  ///< Of the objects in each cell of the rank's Grid.
  std::array<Aabb, most_large> large;  ///< Of one object each.
};

/// Divides space into 4 x 4 x 4 cells. An object is in the cell of its centroid.
class Grid {
 public:
  Grid() = default;
  /// Along each axis, a quarter of a sample is in each of the four intervals.
  explicit Grid(std::span<const Aabb> sample);

  /// For every box, also an infinite one.
  [[nodiscard]] std::size_t cell_of(const Corners& box) const noexcept {
    const Lanes c = box.centroid();
    const auto intervals = -((c > borders_[0]) + (c > borders_[1]) + (c > borders_[2]));
    const int cell = 16 * intervals[0] + 4 * intervals[1] + intervals[2];
    return static_cast<std::size_t>(cell);
  }
  /// Whether a box would make that of its cell useless, since it is longer than most cells, or is outside the
  /// space in which most boxes are.
  [[nodiscard]] bool is_large(const Aabb& box) const noexcept;
  /// A typical edge of a cell.
  [[nodiscard]] float cell_size() const noexcept { return cell_size_; }

 private:
  std::array<Lanes, 3> borders_{};          // between the four intervals of each axis
  std::array<float, 3> lower_{}, upper_{};  // of the space in which most boxes are
  float cell_size_ = 0;
};

/// The current bounds of a rank's objects, without a margin.
struct Survey {
  Survey();

  struct Large {
    std::uint32_t id;
    Aabb box;
  };
  std::array<Aabb, cell_count> cells;  ///< Of all objects that are not in `large`.
  std::vector<Large> large;            ///< By id; at most most_large.

  /// Takes in an object. Those of one survey must come in the order of their ids.
  void add(const Grid& grid, std::uint32_t id, const Aabb& box);
  /// Takes in a survey of objects with higher ids.
  void add(const Grid& grid, const Survey& other);
};

/// Some boxes, evenly selected; all if there are few. No improper ones.
[[nodiscard]] std::vector<Aabb> sample_of(std::span<const Aabb> boxes);
/// @param boxes By id; improper ones do not count.
[[nodiscard]] Survey survey_of(const Grid& grid, std::span<const Aabb> boxes, const Threads& threads);

/// What a rank has told the others about its objects. It has a margin, so that it remains true while objects
/// move a little.
class OwnBounds {
 public:
  /// Numbers of an object's place: its cell, or one of these.
  static constexpr std::size_t alone = cell_count, outside = alone + 1;

  /// Whether there should be new bounds, although these may be true.
  /// @param objects How many there are now.
  [[nodiscard]] bool are_due(std::size_t objects) const noexcept;
  /// @param objects How many there were in the survey.
  void renew(const Grid& grid, const Survey& survey, std::size_t objects);
  /// Notes an update in which something moved.
  void grow_older() noexcept { ++age_; }

  [[nodiscard]] const Bounds& get() const noexcept { return bounds_; }

  /// The number of a cell or `alone`, if the bounds there contain the box; otherwise `outside`.
  [[nodiscard]] std::size_t place_of(std::uint32_t id, const Corners& box) const noexcept {
    const std::size_t cell = grid_.cell_of(box);
    return contains(cells_[cell], box) ? cell : place_of_large(id, box);
  }

 private:
  [[nodiscard]] std::size_t place_of_large(std::uint32_t id, const Corners& box) const noexcept;

  Grid grid_;
  Bounds bounds_{};
  std::array<Corners, cell_count> cells_{};  // of bounds_
  std::vector<std::uint32_t> large_ids_;     // of bounds_, ascending
  float margin_ = 1.0F / 64;                 // in cells
  std::size_t age_ = 0;                      // updates
  std::size_t objects_ = 0;
  bool are_there_ = false;
};

/// A pair of ranks has one that sends and one that finds.
[[nodiscard]] constexpr bool sends(std::size_t from, std::size_t to) noexcept {
  return ((from + to) % 2 == 1) == (from < to);
}

/// Finds out to which halos of this rank an object belongs. Halo r, for another rank r, consists of the
/// objects that rank r needs to find its pairs; halo `rank`, of this rank itself, of those that may have
/// pairs that this rank has to find.
class Neighbours {
 public:
  struct Candidate {
    std::uint32_t halo;
    Corners box;
  };

  /// @param all By rank.
  void set(std::size_t rank, const OwnBounds& own, std::span<const Bounds> all);

  /// To be called after set(), with the interiors of all ranks, by rank.
  void set_interior(std::size_t rank, std::span<const Aabb> interiors);

  /// Calls function(halo) for each halo of an object.
  /// @returns Whether this rank's bounds contain the box. If not, there are no calls.
  template <class Function>
  [[nodiscard]] bool for_each_halo(const OwnBounds& own, std::uint32_t id, const Aabb& box,
                                   const Function& function) const {
    const Corners corners(box);
    if (contains(interior_, corners) || !is_proper(box)) return true;
    const std::size_t place = own.place_of(id, corners);
    if (place == OwnBounds::outside) return false;
    if (!meet(hulls_[place], corners)) return true;
    std::uint32_t found = none;
    for (const Candidate& candidate : of(place)) {
      if (candidate.halo == found || !meet(candidate.box, corners)) continue;
      found = candidate.halo;
      function(found);
    }
    return true;
  }
  /// A box that meets no bounds of another rank, nor its interior. So objects inside belong to no halo,
  /// whatever this rank's own bounds are. This is all that is computed for most objects.
  [[nodiscard]] const Aabb& interior() const noexcept { return interior_box_; }

 private:
  static constexpr std::uint32_t none = ~std::uint32_t{0};

  /// What an object in a cell, or one that is `alone`, may overlap; by halo.
  [[nodiscard]] std::span<const Candidate> of(std::size_t place) const noexcept {
    return std::span(candidates_).subspan(begin_[place], begin_[place + 1] - begin_[place]);
  }

  std::vector<Candidate> candidates_;  // by place
  std::array<std::size_t, cell_count + 2> begin_{};
  Aabb interior_box_{};
  Corners interior_;
  std::array<Corners, cell_count + 1> hulls_{};  // of the candidates of each place
};

}  // namespace broadcl::mpi
