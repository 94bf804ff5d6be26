#pragma once

#ifdef BROADCL_MPI_ON_DEVICE
#include "mpi_on_device.hpp"  // before <CL/cl.h>: it chooses the version
#endif

#include <mpi.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/mpi.hpp>

#include "base/packed_box.hpp"

namespace broadcl::test {

inline int world_rank() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}
inline int world_size() {
  int size = 0;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

#ifdef BROADCL_MPI_ON_DEVICE
using TestedRanks = MpiOnDevice;
/// Each index is always the same object's.
constexpr bool ids_are_recycled = false;
#else
using TestedRanks = MpiBroadPhase;
constexpr bool ids_are_recycled = true;
inline void prepare(MpiBroadPhase& /*tested*/) {}
inline std::span<const Pair> read(const MpiBroadPhase& /*tested*/, std::span<const Pair> pairs) {
  return pairs;
}
#endif

/// What is tested, and one BroadPhase that has the objects of all ranks. Every rank makes the calls of all
/// ranks to the latter, so each knows the expected result without asking.
class MpiTwins {
 public:
  /// @param most Ids of each rank.
  explicit MpiTwins(const Config& config, std::uint32_t most = 256)
      : rank_(world_rank()),
        most_(most),
        tested_(MPI_COMM_WORLD, config),
        expected_({.algorithm = "sweep-and-prune", .threads = 1}),
        is_live_(static_cast<std::size_t>(world_size()), std::vector<bool>(most)),
        boxes_(most, empty_aabb()) {
    (void)expected_.map(most * is_live_.size());
  }

  [[nodiscard]] TestedRanks& tested() { return tested_; }

  // The calls of one rank. All ranks make them with the same arguments.

  std::uint32_t add(int rank, const Aabb& box, const Filter& filter = Filter()) {
    std::vector<bool>& is_live = of(rank);
    const auto free = std::find(is_live.begin(), is_live.end(), false);
    const auto id = static_cast<std::uint32_t>(free - is_live.begin());
    *free = true;
    if (rank == rank_) {
      EXPECT_EQ(tested_.add(box, filter), id);
      boxes_[id] = box;
    }
    replace(slot(rank, id), box, filter);
    return id;
  }
  void remove(int rank, std::uint32_t id) {
    of(rank)[id] = false;
    if (rank == rank_) {
      tested_.remove(id);
      boxes_[id] = empty_aabb();
    }
    replace(slot(rank, id), empty_aabb(), Filter());
  }
  void move(int rank, std::uint32_t id, const Aabb& box) {
    if (rank == rank_) {
      tested_.move(id, box);
      boxes_[id] = box;
    }
    expected_.move(slot(rank, id), box);
  }
  void set_filter(int rank, std::uint32_t id, const Filter& filter) {
    if (rank == rank_) tested_.set_filter(id, filter);
    expected_.set_filter(slot(rank, id), filter);
  }
  /// Excludes the pairs that a function selects: of all pairs of ids below a limit, on any two ranks.
  template <class Function>
  void set_exclusions(std::uint32_t limit, const Function& select) {
    std::vector<MpiPair> excluded;
    std::vector<Pair> expected;
    const std::uint32_t ids = limit * static_cast<std::uint32_t>(world_size());
    for (std::uint32_t b = 0; b < ids; ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        if (!select()) continue;
        const MpiPair pair{mpi_id(static_cast<int>(a / limit), a % limit),
                           mpi_id(static_cast<int>(b / limit), b % limit)};
        expected.push_back(
            {slot(rank_of(pair.a), local_id(pair.a)), slot(rank_of(pair.b), local_id(pair.b))});
        if (rank_of(pair.a) == rank_) excluded.push_back(pair);
      }
    }
    tested_.set_exclusions(excluded);
    expected_.set_exclusions(expected);
  }
  void map(int rank, std::span<const Aabb> boxes) {
    if (rank == rank_) {
      const std::span<Aabb> mapped = tested_.map(boxes.size());
      const auto same = [](const Aabb& s, const Aabb& t) { return same_bits(pack(s), pack(t)); };
      EXPECT_TRUE(std::ranges::equal(mapped, std::span(boxes_).first(boxes.size()), same))
          << "map() must return the boxes as they were given, or empty ones for empty ones";
      std::ranges::fill(boxes_, empty_aabb());
      std::ranges::copy(boxes, boxes_.begin());
      std::ranges::copy(boxes, mapped.begin());
    }
    for (std::uint32_t id = 0; id < most_; ++id) {
      const bool stays = id < boxes.size();
      if (stays && of(rank)[id]) {
        expected_.move(slot(rank, id), boxes[id]);
      } else if (stays || of(rank)[id]) {
        replace(slot(rank, id), stays ? boxes[id] : empty_aabb(), Filter());
      }
      of(rank)[id] = stays;
    }
  }

  [[nodiscard]] bool is_live(int rank, std::uint32_t id) { return of(rank)[id]; }
  [[nodiscard]] std::uint32_t most() const { return most_; }

  /// Updates both and compares what changed.
  void update() {
    prepare();
    compare(tested_.update());
  }
  /// Does the caller's part of an update.
  void prepare() { test::prepare(tested_); }
  template <class Changes>
  void compare(const Changes& changes) {
    const Delta expected = expected_.update();
    EXPECT_EQ(together(read(tested_, changes.own.added), changes.added), own(expected.added));
    EXPECT_EQ(together(read(tested_, changes.own.removed), changes.removed), own(expected.removed));
    changes_ += expected.added.size() + expected.removed.size();
  }
  void compare_pairs() { EXPECT_EQ(tested_.pairs(), own(expected_.pairs())); }

  /// Changes on all ranks so far: to make sure that something happened.
  [[nodiscard]] std::size_t changes() const { return changes_; }

 private:
  /// Gives a slot to another object.
  void replace(std::uint32_t slot, const Aabb& box, const Filter& filter) {
    if (ids_are_recycled) {
      expected_.remove(slot);
      EXPECT_EQ(expected_.add(box, filter), slot);
    } else {
      expected_.move(slot, box);
      expected_.set_filter(slot, filter);
    }
  }
  std::vector<bool>& of(int rank) { return is_live_[static_cast<std::size_t>(rank)]; }
  [[nodiscard]] std::uint32_t slot(int rank, std::uint32_t id) const {
    return static_cast<std::uint32_t>(rank) * most_ + id;
  }
  [[nodiscard]] MpiId mpi(std::uint32_t slot) const {
    return mpi_id(static_cast<int>(slot / most_), slot % most_);
  }
  /// Both parts of a list, one after the other.
  [[nodiscard]] std::vector<MpiPair> together(std::span<const Pair> own,
                                              std::span<const MpiPair> with_others) const {
    std::vector<MpiPair> all;
    for (const auto& [a, b] : own) all.push_back({mpi_id(rank_, a), mpi_id(rank_, b)});
    all.insert(all.end(), with_others.begin(), with_others.end());
    return all;
  }
  [[nodiscard]] std::vector<MpiPair> own(std::span<const Pair> pairs) const {
    std::vector<MpiPair> own;
    for (const Pair& pair : pairs) {
      if (rank_of(mpi(pair.a)) == rank_) own.push_back({mpi(pair.a), mpi(pair.b)});
    }
    return own;
  }

  int rank_;
  std::uint32_t most_;
  TestedRanks tested_;
  BroadPhase expected_;
  std::vector<std::vector<bool>> is_live_;  // by rank and id
  std::vector<Aabb> boxes_;                 // of this rank, by id
  std::size_t changes_ = 0;
};

}  // namespace broadcl::test

namespace broadcl {
/// For messages of tests.
inline std::ostream& operator<<(std::ostream& out, const MpiPair& pair) {
  return out << rank_of(pair.a) << '.' << local_id(pair.a) << '-' << rank_of(pair.b) << '.'
             << local_id(pair.b);
}
}  // namespace broadcl
