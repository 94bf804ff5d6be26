#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "change_set.hpp"
#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// The objects of a rank, as they are now and as they were at the last update. Each function first does what
/// may throw, and then what cannot.
class Objects {
 public:
  // As MpiBroadPhase has them.
  std::uint32_t add(const Aabb& box, const Filter& filter);
  void move(std::uint32_t id, const Aabb& box);
  void set_filter(std::uint32_t id, const Filter& filter);
  void remove(std::uint32_t id);
  std::span<Aabb> map(std::size_t n);
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  /// As of the last update.
  [[nodiscard]] std::size_t last_size() const noexcept { return last_size_; }

  /// Ids 0 .. ids()-1 have been given to objects. Boxes of ids that are free are empty.
  [[nodiscard]] std::size_t ids() const noexcept { return now_.size(); }
  [[nodiscard]] std::span<const Aabb> now() const noexcept { return now_; }
  [[nodiscard]] std::span<const Aabb> last() const noexcept { return last_; }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const noexcept { return filters_[id]; }
  [[nodiscard]] const Filter& last_filter(std::uint32_t id) const noexcept { return last_filters_[id]; }
  /// Whether some object has had another filter than the default one.
  [[nodiscard]] bool any_filters() const noexcept { return any_filters_; }

  /// Since the last commit(); with `all`, every box may be another one. An id whose object is another one is
  /// recycled.
  [[nodiscard]] const ChangeSet& changes() const noexcept { return changes_; }

  /// Makes it possible to commit() what is now. Takes as long as to copy the boxes if all changed.
  void prepare(Workers& workers);
  /// What is now becomes what was at the last update.
  void commit() noexcept;

 private:
  void reserve(std::size_t ids);
  void grow(std::size_t ids) noexcept;
  void give(std::uint32_t id, bool is_live) noexcept;
  void store_filter(std::uint32_t id, const Filter& filter) noexcept;
  void refuse_unknown(std::uint32_t id) const;

  // By id. The boxes of now_ are as the caller gave them.
  std::vector<Aabb> now_, last_;
  std::vector<Filter> filters_, last_filters_;
  std::vector<char> is_live_;
  std::vector<Aabb> spare_;          // takes the place of now_ if all changed
  std::vector<std::uint32_t> free_;  // a heap, the lowest id first
  std::size_t capacity_ = 0;         // ids that all of these, but for spare_, have capacity for
  std::size_t size_ = 0;
  std::size_t last_size_ = 0;
  bool any_filters_ = false;
  ChangeSet changes_;
};

}  // namespace broadcl::mpi
