#pragma once

#ifdef BROADCL_MPI_ON_DEVICE
#include "mpi_on_device.hpp"  // before <CL/cl.h>: it chooses the version
#endif

#include <mpi.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/mpi.hpp>

#include "base/packed_box.hpp"
#include "random_scripts.hpp"

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

/// The first argument of the program.
inline std::string algorithm_under_test = "sweep-and-prune";

/// Fewer frames if the device is a CPU.
inline int frames(int on_the_host) {
  return algorithm_under_test == "sweep-and-prune" ? on_the_host : on_the_host / 8 + 2;
}

inline Config config() {
  return {.algorithm = algorithm_under_test, .threads = 2};
}

/// The same on all ranks, so that none stops while others continue.
inline bool has_failed() {
  int failed = ::testing::Test::HasFailure() ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  return failed != 0;
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
/// ranks to the latter, so each knows the expected result without asking. What is wrong on one rank ends the
/// test or the script on all, in the next collective function.
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
      if (tested_.add(box, filter) != id) note("another id than the lowest that is free");
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
  /// @param pairs Of slots; others are left out.
  void set_exclusions(const std::vector<Pair>& pairs) {
    std::vector<MpiPair> excluded;
    std::vector<Pair> expected;
    for (const Pair& pair : pairs) {
      const auto [a, b] = std::minmax(pair.a, pair.b);
      if (b >= most_ * is_live_.size()) continue;
      expected.push_back({a, b});
      if (rank_of(mpi(a)) == rank_) excluded.push_back({mpi(a), mpi(b)});
    }
    tested_.set_exclusions(excluded);
    expected_.set_exclusions(expected);
  }
  /// A call of one rank, which must throw an Error with this text.
  template <class Function>
  void refuse(int rank, std::string_view text, const Function& function) {
    if (rank != rank_) return;
    try {
      require_error(text, [&] { function(tested_); });
    } catch (const std::exception& error) {
      note(error.what());
    }
  }
  void map(int rank, std::span<const Aabb> boxes) {
    if (rank == rank_) {
      const std::span<Aabb> mapped = tested_.map(boxes.size());
      const auto same = [](const Aabb& s, const Aabb& t) { return same_bits(pack(s), pack(t)); };
      if (!std::ranges::equal(mapped, std::span(boxes_).first(boxes.size()), same)) {
        note("map() must return the boxes as they were given, or empty ones for empty ones");
      }
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

  /// The objects of all ranks.
  [[nodiscard]] std::vector<MpiId> objects() const {
    std::vector<MpiId> objects;
    for (std::uint32_t k = 0; k < most_ * is_live_.size(); ++k) {
      if (is_live_[k / most_][k % most_]) objects.push_back(mpi(k));
    }
    return objects;
  }
  /// Of a rank, by id, up to the last object.
  [[nodiscard]] std::vector<Aabb> boxes(int rank) const {
    std::vector<Aabb> boxes;
    for (const MpiId id : objects()) {
      if (rank_of(id) != rank) continue;
      boxes.resize(local_id(id) + 1, empty_aabb());
      boxes.back() = box(rank, local_id(id));
    }
    return boxes;
  }
  [[nodiscard]] Aabb box(int rank, std::uint32_t id) const { return expected_.box(slot(rank, id)); }
  [[nodiscard]] Filter filter(int rank, std::uint32_t id) const { return expected_.filter(slot(rank, id)); }
  /// All pairs, as of the last update, of slots.
  [[nodiscard]] std::vector<Pair> present() const { return expected_.pairs(); }
  /// The number of an object among those of all ranks.
  [[nodiscard]] std::uint32_t slot(MpiId id) const { return slot(rank_of(id), local_id(id)); }

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
    compare("added", together(read(tested_, changes.own.added), changes.added), own(expected.added));
    compare("removed", together(read(tested_, changes.own.removed), changes.removed), own(expected.removed));
    changes_ += expected.added.size() + expected.removed.size();
    end_if_wrong();
  }
  void compare_pairs() {
    compare("pairs", tested_.pairs(), own(expected_.pairs()));
    end_if_wrong();
  }

  /// Changes on all ranks so far: to make sure that something happened.
  [[nodiscard]] std::size_t changes() const { return changes_; }

 private:
  /// Gives a slot to another object.
  void replace(std::uint32_t slot, const Aabb& box, const Filter& filter) {
    if (ids_are_recycled) {
      expected_.remove(slot);
      if (expected_.add(box, filter) != slot) note("another slot");
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

  void compare(const std::string& what, const std::vector<MpiPair>& is,
               const std::vector<MpiPair>& expected) {
    if (is == expected) return;
    note(what + " are " + ::testing::PrintToString(is) + ", expected " + ::testing::PrintToString(expected));
  }
  void note(const std::string& wrong) {
    if (wrong_.empty()) wrong_ = "rank " + std::to_string(rank_) + ": " + wrong;
  }
  void end_if_wrong() const {
    int first = wrong_.empty() ? world_size() : rank_;
    MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
    if (first < world_size()) fail(wrong_.empty() ? "wrong on rank " + std::to_string(first) : wrong_);
  }

  int rank_;
  std::uint32_t most_;
  TestedRanks tested_;
  BroadPhase expected_;
  std::vector<std::vector<bool>> is_live_;  // by rank and id
  std::vector<Aabb> boxes_;                 // of this rank, by id
  std::size_t changes_ = 0;
  std::string wrong_;  // on this rank
};

}  // namespace broadcl::test

namespace broadcl {
/// For messages of tests.
inline std::ostream& operator<<(std::ostream& out, const MpiPair& pair) {
  return out << rank_of(pair.a) << '.' << local_id(pair.a) << '-' << rank_of(pair.b) << '.'
             << local_id(pair.b);
}
}  // namespace broadcl
