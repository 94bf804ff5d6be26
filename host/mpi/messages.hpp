#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/mpi.hpp>

#include "mpi/ranks.hpp"

/// The messages between ranks in an update. A copy of an object in the region of another rank is identified
/// by a number, which the object's rank assigns for that other rank.
namespace broadcl::mpi {

struct Move {
  std::uint32_t copy;
  Aabb box;
};

struct Refilter {
  std::uint32_t copy;
  Filter filter;
};

struct Enter {
  std::uint32_t copy;
  std::uint32_t id;
  Aabb box;
  Aabb last;  ///< Box and filter of the last update: an empty one for a new object.
  Filter filter;
  Filter last_filter;
};

struct Leave {
  std::uint32_t copy;
  Aabb box;  ///< Its current box; empty if it was removed.
  Filter filter;
};

/// The lengths of the arrays of a message, which has two or four arrays, one after the other.
template <std::size_t arrays>
struct Counts {
  std::array<std::uint64_t, arrays> of;
};

/// Reads a message array by array.
class Reader {
 public:
  explicit Reader(const Bytes& message) : next_(message.data()), is_empty_(message.size() == 0) {}

  template <std::size_t arrays>
  [[nodiscard]] Counts<arrays> counts() {
    Counts<arrays> counts{};
    if (!is_empty_) std::memcpy(&counts, take(sizeof(counts)), sizeof(counts));
    return counts;
  }
  template <class Value>
  [[nodiscard]] std::span<const Value> array(std::uint64_t count) {
    static_assert(std::is_trivially_copyable_v<Value>);
    return {reinterpret_cast<const Value*>(take(count * sizeof(Value))), count};
  }

 private:
  const std::byte* take(std::size_t bytes) {
    const std::byte* taken = next_;
    next_ += bytes;
    return taken;
  }

  const std::byte* next_;
  bool is_empty_;
};

/// A message from a rank to another about its objects.
struct Tidings {
  std::span<const Move> moves;
  std::span<const Enter> enters;
  std::span<const Leave> leaves;  ///< Processed before the others, since a number may be reused.
  std::span<const Refilter> refilters;

  explicit Tidings(const Bytes& message) {
    Reader reader(message);
    const auto counts = reader.counts<4>();
    moves = reader.array<Move>(counts.of[0]);
    enters = reader.array<Enter>(counts.of[1]);
    leaves = reader.array<Leave>(counts.of[2]);
    refilters = reader.array<Refilter>(counts.of[3]);
  }
};

/// A message about changed pairs, for the rank of their first objects.
struct Changed {
  std::span<const MpiPair> added;
  std::span<const MpiPair> removed;

  explicit Changed(const Bytes& message) {
    Reader reader(message);
    const auto counts = reader.counts<2>();
    added = reader.array<MpiPair>(counts.of[0]);
    removed = reader.array<MpiPair>(counts.of[1]);
  }
};

}  // namespace broadcl::mpi
