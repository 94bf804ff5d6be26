#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "base/non_copyable.hpp"
#include "mpi/bounds.hpp"
#include "mpi/halos.hpp"

namespace broadcl::mpi {

/// The objects of a rank, as CrossPairs sees them: on the host or on a device.
class Objects : NonCopyable {
 public:
  virtual ~Objects() = default;

  /// Starts an update of the pairs of two objects of this rank, and finds the objects that belong to halos:
  /// among those that changed(), or among all if have_all_changed().
  /// @param own Null if no halos are wanted.
  /// @param near By halo.
  /// @returns Whether the bounds contain all objects. If not, `near` may be incomplete.
  /// @throws As BroadPhase::begin(); then there is no update.
  [[nodiscard]] virtual bool begin(const OwnBounds* own, const Neighbours& neighbours,
                                   std::vector<Halo>& near) = 0;

  // Of the update that was begun.

  /// How many there are.
  [[nodiscard]] virtual std::size_t count() const = 0;
  /// Packed, by id; empty ones for ids that are free. Perhaps copied from a device.
  [[nodiscard]] virtual std::span<const Aabb> boxes() = 0;
  /// By id; none if all are the default one.
  [[nodiscard]] virtual std::span<const Filter> filters() = 0;

  // What changed since the last update that succeeded on all ranks.

  /// Whether every object counts as changed.
  [[nodiscard]] virtual bool have_all_changed() const = 0;
  /// Otherwise, the ids that changed, ascending.
  [[nodiscard]] virtual std::span<const std::uint32_t> changed() const = 0;
  /// Ids that belong to other objects than before, ascending.
  [[nodiscard]] virtual std::span<const std::uint32_t> recycled() const = 0;
};

}  // namespace broadcl::mpi
