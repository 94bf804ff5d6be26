#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "mpi/bounds.hpp"
#include "mpi/halos.hpp"

namespace broadcl::mpi {

/// The objects of a rank, as CrossPairs sees them: on the host or on a device.
class Objects {
 public:
  Objects() = default;
  virtual ~Objects() = default;
  Objects(const Objects&) = delete;
  Objects& operator=(const Objects&) = delete;
  Objects(Objects&&) = delete;
  Objects& operator=(Objects&&) = delete;

  /// Starts an update of the pairs of two objects of this rank.
  /// @param own Null to find nothing; otherwise find_near() is done, too, among all objects if
  /// have_all_changed().
  /// @throws As BroadPhase::begin(); then there is no update.
  [[nodiscard]] virtual bool begin(const OwnBounds* own, const Neighbours& neighbours,
                                   std::vector<Halo>& near) = 0;

  /// How many there are.
  [[nodiscard]] virtual std::size_t count() const = 0;
  /// Some boxes, evenly selected; all if there are few.
  [[nodiscard]] virtual std::vector<Aabb> sample() = 0;
  [[nodiscard]] virtual Survey survey(const Grid& grid) = 0;

  // What changed since the last update that succeeded on all ranks.

  /// Whether every object counts as changed.
  [[nodiscard]] virtual bool have_all_changed() const = 0;
  /// Otherwise, the ids that changed, ascending.
  [[nodiscard]] virtual std::span<const std::uint32_t> changed() const = 0;
  /// Ids that belong to other objects than before, ascending.
  [[nodiscard]] virtual std::span<const std::uint32_t> recycled() const = 0;

  /// Finds the objects that belong to halos.
  /// @param all Among all objects; otherwise among those that changed().
  /// @returns Whether the bounds contain all of them. If not, `near` may be incomplete.
  [[nodiscard]] virtual bool find_near(const OwnBounds& own, const Neighbours& neighbours, bool all,
                                       std::vector<Halo>& near) = 0;
};

}  // namespace broadcl::mpi
