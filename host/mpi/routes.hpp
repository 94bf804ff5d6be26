#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <optional>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>

#include "mpi/cuts.hpp"
#include "mpi/messages.hpp"
#include "mpi/objects.hpp"
#include "mpi/region.hpp"
#include "mpi/workers.hpp"

namespace broadcl::mpi {

/// Records which regions have copies of the objects of a rank, and determines what to send when that changes.
class Routes {
 public:
  Routes(std::size_t rank, std::size_t ranks, Workers& workers);

  /// Forgets all copies.
  void clear() noexcept;

  enum class To {
    now,   ///< From what was at the last update to what is now; `all` if regions are others, too.
    last,  ///< From nothing to what was at the last update.
  };

  /// Updates this rank's own region, and writes the messages for other ranks. Can only be undone by clear().
  /// @param objects If their boxes are lent, they must be lent to the region.
  /// @param all Whether any object may have to change its region, not only those that changed.
  /// @param out By rank.
  /// @returns Whether the region's boxes were written in place.
  /// @throws Error for a NaN bound.
  bool route(Objects& objects, const Cuts& cuts, To to, bool all, Region& region, std::vector<Bytes>& out);
  void commit() noexcept;

  /// Writes the boxes of the objects that are not in this rank's own region, as of the last update.
  void write_absent(std::span<const Aabb> boxes, std::span<Aabb> to);

  /// Whether an object is, and was at the last update, in this rank's region and in no other.
  [[nodiscard]] bool is_settled(std::uint32_t id) const noexcept {
    return where_[id] == here && (next_[id] & ~another) == here;
  }
  /// Whether this id belongs to another object than at the last update.
  [[nodiscard]] bool is_another(std::uint32_t id) const noexcept { return (next_[id] & another) != 0; }
  /// Number of objects in this rank's region.
  [[nodiscard]] std::size_t here_count() const noexcept { return here_count_; }

 private:
  // Bits of where_ and next_.
  static constexpr std::uint8_t here = 1;       // in this rank's region
  static constexpr std::uint8_t elsewhere = 2;  // in others
  static constexpr std::uint8_t another = 4;    // the object is another one than at the last update

  /// A copy in the region of another rank. The copies of an object form a list, by rank.
  struct Copy {
    std::uint32_t rank;
    std::uint32_t number;
    std::uint32_t next;
  };
  static constexpr std::uint32_t none = 0xffffffff;

  /// The results of one task.
  struct Part {
    std::vector<std::vector<Move>> moves;          // by rank
    std::vector<std::vector<Refilter>> refilters;  // by rank
    std::vector<std::uint32_t> rerouted;           // objects whose regions changed
    std::vector<std::uint32_t> altered;            // objects whose next_ differs from where_
    std::vector<std::uint32_t> touched;            // the regions of one object
    std::vector<std::uint32_t> leaving;            // objects of one block that may be in other regions
    std::ptrdiff_t here_count = 0;                 // added to Routes::here_count_
    std::optional<std::uint32_t> nan;              // an object with a NaN bound
    std::exception_ptr failure;

    void clear() noexcept;
  };

  /// The arguments of route().
  struct Journey {
    Objects& objects;
    const Cuts& cuts;
    Cuts::Bounds own;
    To to;
    bool all;
    std::span<const Aabb> boxes;
    std::span<Aabb> in_place;  // the boxes of the region, or none
  };

  [[nodiscard]] Filter filter(const Journey& journey, std::uint32_t id) const noexcept;
  void filter_own(const Journey& journey, Region& region);
  void end_replaced(const Journey& journey, Region& region);
  void route_part(const Journey& journey, std::size_t begin, std::size_t end, Region& region, Part& part);
  void route_leaving(const Journey& journey, std::span<const std::uint32_t> leaving, Region& region,
                     Part& part);
  void route_one(const Journey& journey, std::uint32_t id, Region& region, Part& part);
  [[nodiscard]] bool touch(const Journey& journey, const Aabb& box, std::vector<std::uint32_t>& others) const;
  void reroute(const Journey& journey, std::uint32_t id, Part& part);
  void keep_up(const Journey& journey, std::uint32_t id, const Copy& copy, Part& part) const;
  void leave(const Copy& copy, const Aabb& box, const Filter& filter);
  [[nodiscard]] std::uint32_t enter(const Journey& journey, std::uint32_t id, std::uint32_t rank);
  void write(std::vector<Bytes>& out);

  std::size_t rank_;
  Workers& workers_;
  std::vector<std::uint8_t> where_,
      next_;  // by id: at the last update, and now; equal except where something changed
  std::vector<std::uint32_t> first_copy_;  // by id
  std::vector<Copy> copies_;
  std::vector<std::uint32_t> free_copies_;
  struct Numbers {
    std::uint32_t count = 0;
    std::vector<std::uint32_t> free;
  };
  std::vector<Numbers> numbers_;  // by rank
  std::size_t here_count_ = 0;

  std::vector<Part> parts_;
  std::vector<std::vector<Enter>> enters_;  // by rank
  std::vector<std::vector<Leave>> leaves_;  // by rank
};

}  // namespace broadcl::mpi
