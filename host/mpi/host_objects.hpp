#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/config.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

#include "base/threads.hpp"
#include "core/change_set.hpp"
#include "core/core.hpp"
#include "engines/algorithm.hpp"
#include "mpi/bounds.hpp"
#include "mpi/halos.hpp"
#include "mpi/objects.hpp"

namespace broadcl::mpi {

/// The objects of a rank in a Core, which finds the pairs among them, and what changed since the last
/// commit(). An update of the Core that was not followed by commit(), because another rank failed,
/// counts as if it had not been done.
class HostObjects final : public Objects {
 public:
  explicit HostObjects(const Config& config)
      : search_(make_algorithm(config), Threads(config)), threads_(config) {}

  // Like the functions of MpiBroadPhase.
  std::uint32_t add(const Aabb& box, const Filter& filter);
  void move(std::uint32_t id, const Aabb& box);
  void set_filter(std::uint32_t id, const Filter& filter);
  void remove(std::uint32_t id);
  std::span<Aabb> map(std::size_t n);

  void set_exclusions(std::span<const Pair> pairs) { search_.set_exclusions(pairs); }

  /// Ends the update that was begun.
  /// @returns What changed since the last commit(); valid until the next update.
  Delta finish();
  /// Ends the update that was begun, if there is one. If that fails, the next one finds its changes, too.
  void abandon() noexcept;
  void commit() noexcept;
  /// All pairs of two objects of this rank, as of the last commit().
  [[nodiscard]] std::vector<Pair> pairs() const;
  [[nodiscard]] const Core<Aabb>& search() const noexcept { return search_; }

  [[nodiscard]] bool begin(const OwnBounds* own, const Neighbours& neighbours,
                           std::vector<Halo>& near) override;
  [[nodiscard]] std::size_t count() const override { return search_.size(); }
  [[nodiscard]] std::span<const Aabb> boxes() override { return search_.boxes().first(ids_); }
  [[nodiscard]] std::span<const Filter> filters() override { return search_.filters(); }
  [[nodiscard]] bool have_all_changed() const override;
  [[nodiscard]] std::span<const std::uint32_t> changed() const override { return changed_; }
  [[nodiscard]] std::span<const std::uint32_t> recycled() const override { return changes_.recycled(); }

 private:
  void reserve(std::size_t ids);

  Core<Aabb> search_;
  Threads threads_;
  std::size_t ids_ = 0;       // All ids are below.
  std::size_t reserved_ = 0;  // ids, in changes_
  ChangeSet changes_;
  std::vector<std::uint32_t> changed_;  // of the update that was begun
  std::vector<Delta> deltas_;           // of the updates since the last commit()
  bool is_begun_ = false;
};

}  // namespace broadcl::mpi
