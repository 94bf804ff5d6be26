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
  explicit Objects(Workers& workers) : workers_(workers) {}

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
  /// If they are lent, only those that were kept().
  [[nodiscard]] std::span<const Aabb> now() const noexcept { return is_now_last_ ? last_ : now_; }
  [[nodiscard]] std::span<const Aabb> last() const noexcept { return last_; }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const noexcept { return filters_[id]; }
  [[nodiscard]] const Filter& last_filter(std::uint32_t id) const noexcept { return last_filters_[id]; }
  /// Whether some object has had another filter than the default one.
  [[nodiscard]] bool any_filters() const noexcept { return any_filters_; }

  /// Since the last commit(); with `all`, every box may be another one. An id whose object is another one is
  /// recycled.
  [[nodiscard]] const ChangeSet& changes() const noexcept { return changes_; }

  // All boxes may be lent: they are in other memory then, where they may be written, until they are taken
  // back. No other function that changes objects may be called meanwhile.

  /// Whether nothing changed, and ids 0 .. n-1 are those of the objects.
  [[nodiscard]] bool can_be_lent(std::size_t n) const noexcept {
    return changes_.empty() && n == ids() && n == size_;
  }
  void lend() noexcept;
  [[nodiscard]] bool are_lent() const noexcept { return are_lent_; }
  /// A box that is about to be overwritten where it was lent to. Several threads may call it, for other ids.
  void keep(std::uint32_t id, const Aabb& box) noexcept { now_[id] = box; }
  /// What is a NaN where they were lent to has been kept.
  void packed() noexcept { are_packed_ = true; }
  /// No-op if they are not lent.
  void take_back(std::span<const Aabb> boxes) noexcept;

  /// What is now becomes what was at the last update.
  void commit() noexcept;

 private:
  void reserve(std::size_t ids);
  void grow(std::size_t ids) noexcept;
  void settle() noexcept;
  void give(std::uint32_t id, bool is_live) noexcept;
  void store_filter(std::uint32_t id, const Filter& filter) noexcept;
  void refuse_unknown(std::uint32_t id) const;

  Workers& workers_;
  // By id. The boxes of now_ are as the caller gave them.
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
  bool are_packed_ = false;  // where they were lent to, those that are not searched there are NaNs
  ChangeSet changes_;
};

}  // namespace broadcl::mpi
