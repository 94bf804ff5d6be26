#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "core/change_set.hpp"
#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// The objects of a rank, as they are now and as they were at the last update. Each function first does
/// everything that may throw.
class Objects {
 public:
  explicit Objects(Workers& workers) : workers_(workers) {}

  // Like the functions of MpiBroadPhase.
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
  /// While the boxes are lent, only those that were passed to keep() are valid.
  [[nodiscard]] std::span<const Aabb> now() const noexcept { return is_now_last_ ? last_ : now_; }
  [[nodiscard]] std::span<const Aabb> last() const noexcept { return last_; }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const noexcept { return filters_[id]; }
  [[nodiscard]] const Filter& last_filter(std::uint32_t id) const noexcept { return last_filters_[id]; }
  /// Whether some object has had a filter other than the default.
  [[nodiscard]] bool any_filters() const noexcept { return any_filters_; }

  /// The changes since the last commit(). With `all`, every box may have changed. An id that now belongs to
  /// another object is recycled.
  [[nodiscard]] const ChangeSet& changes() const noexcept { return changes_; }

  // All boxes may be lent: until they are taken back, they are in other memory, where they may be written. No
  // other function that changes objects may be called until then.

  /// Whether nothing changed, and ids 0 .. n-1 are those of the objects.
  [[nodiscard]] bool can_be_lent(std::size_t n) const noexcept {
    return changes_.empty() && n == ids() && n == size_;
  }
  void lend() noexcept;
  [[nodiscard]] bool are_lent() const noexcept { return are_lent_; }
  /// Stores a lent box that is about to be overwritten. Several threads may call this at the same time, for
  /// different ids.
  void keep(std::uint32_t id, const Aabb& box) noexcept { now_[id] = box; }
  /// Call this when every box that is a NaN in the other memory has been passed to keep().
  void packed() noexcept { are_packed_ = true; }
  /// No-op if they are not lent.
  void take_back(std::span<const Aabb> boxes) noexcept;

  /// Makes the current state that of the last update.
  void commit() noexcept;

 private:
  void reserve(std::size_t ids);
  void grow(std::size_t ids) noexcept;
  void settle() noexcept;
  void give(std::uint32_t id, bool is_live) noexcept;
  void store_filter(std::uint32_t id, const Filter& filter) noexcept;
  void refuse_unknown(std::uint32_t id) const;

  Workers& workers_;
  // By id. The boxes of now_ are those given by the caller.
  std::vector<Aabb> now_, last_;
  std::vector<Filter> filters_, last_filters_;
  std::vector<char> is_live_;
  std::vector<std::uint32_t> free_;  // a heap, the lowest id first
  std::size_t capacity_ = 0;         // ids that all of these have capacity for
  std::size_t size_ = 0;
  std::size_t last_size_ = 0;
  bool any_filters_ = false;
  bool is_now_last_ = false;  // nothing changed since the last update, and now_ has something else
  bool are_lent_ = false;
  bool are_packed_ = false;  // in the other memory, boxes that are not searched are NaNs
  ChangeSet changes_;
};

}  // namespace broadcl::mpi
