#pragma once

#include <mpi.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/mpi.hpp>

#include "boxes.hpp"
#include "mpi_twins.hpp"

/// Random changes of the objects of all ranks.
namespace broadcl::test {

/// The first argument of the program.
inline std::string algorithm_under_test = "sweep-and-prune";

/// Fewer frames if the device is a CPU.
inline int frames(int on_the_host) {
  return algorithm_under_test == "sweep-and-prune" ? on_the_host : on_the_host / 8 + 2;
}

inline Config config() {
  return {.algorithm = algorithm_under_test, .threads = 2};
}

/// The same random numbers on every rank.
class Dice {
 public:
  explicit Dice(std::uint32_t seed) : engine_(seed) {}

  std::uint32_t below(std::uint32_t end) { return static_cast<std::uint32_t>(engine_() % end); }
  float uniform(float lower, float upper) {
    return lower + (upper - lower) * static_cast<float>(engine_() >> 8U) * 0x1p-24F;
  }
  int rank() { return static_cast<int>(below(static_cast<std::uint32_t>(world_size()))); }

  Aabb cube(float edge, float world = 1) {
    Aabb box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = uniform(0, world);
      box.upper[axis] = box.lower[axis] + edge;
    }
    return box;
  }
  /// On a lattice, so that boxes touch each other and the bounds of ranks.
  Aabb on_lattice() {
    Aabb box{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      box.lower[axis] = static_cast<float>(below(7)) - 3;
      box.upper[axis] = box.lower[axis] + static_cast<float>(below(3));
    }
    return box;
  }
  Aabb any() {
    switch (below(16)) {
      case 0:
        return empty_aabb();
      case 1: {  // half of space
        Aabb box = cube(0.1F);
        (below(2) == 0 ? box.lower : box.upper)[below(3)] = below(2) == 0 ? -infinity : infinity;
        return box;
      }
      case 2:
        return {{-infinity, -infinity, -infinity}, {infinity, infinity, infinity}};
      case 3:  // at the end of space
        return {{infinity, 0.5F, 0.5F}, {infinity, 0.6F, 0.6F}};
      case 4:
        return {{-infinity, 0, 0}, {-infinity, 1, 1}};
      case 5:
        return cube(1.5F);
      case 6:
        return cube(0);
      case 7:
      case 8:
      case 9:
        return on_lattice();
      default:
        return cube(0.2F);
    }
  }
  Filter filter() {
    return {.group = 1U << below(3),
            .mask = below(8),
            .body = below(4) == 0 ? below(4) : Filter::no_body,
            .world = below(4) == 0 ? Filter::all_worlds : below(2)};
  }

 private:
  std::mt19937 engine_;
};

template <class Function>
std::string error_of(const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// The same on all ranks, so that none stops while others continue.
inline bool has_failed() {
  int failed = ::testing::Test::HasFailure() ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  return failed != 0;
}

/// Does something random to an object of a random rank.
inline void do_anything(MpiTwins& twins, Dice& dice, bool filters) {
  const int rank = dice.rank();
  const std::uint32_t id = dice.below(48);
  const std::uint32_t what = dice.below(8);
  const Aabb box = dice.any();
  const Filter filter = filters && dice.below(2) == 0 ? dice.filter() : Filter();
  if (!twins.is_live(rank, id)) {
    twins.add(rank, box, filter);
  } else if (what == 0) {
    twins.remove(rank, id);
  } else if (what == 1) {  // its id for another object
    twins.remove(rank, id);
    twins.add(rank, box, filter);
  } else if (what == 2) {
    twins.set_filter(rank, id, filter);
  } else {
    twins.move(rank, id, box);
  }
}

/// Writes the boxes of all objects of each rank, in place if their number is unchanged and nothing else
/// changed.
inline void map_all(MpiTwins& twins, Dice& dice) {
  for (int rank = 0; rank < world_size(); ++rank) {
    std::vector<Aabb> boxes(20);
    for (Aabb& box : boxes) box = dice.any();
    twins.map(rank, boxes);
  }
}

}  // namespace broadcl::test
