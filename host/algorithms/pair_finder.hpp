#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "algorithms/pair_delta.hpp"
#include "algorithms/search.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// The part of an algorithm that finds pairs on the device.
class PairFinder {
 public:
  PairFinder() = default;
  virtual ~PairFinder() = default;
  PairFinder(const PairFinder&) = delete;
  PairFinder& operator=(const PairFinder&) = delete;
  PairFinder(PairFinder&&) = delete;
  PairFinder& operator=(PairFinder&&) = delete;

  struct Grain {
    double factor;
    std::string_view name;  ///< Of a Stage.
  };
  /// What set_grain() is tried with on a device.
  static constexpr std::array grains{Grain{1, "grain 1"}, Grain{0.25, "grain 1/4"}, Grain{4, "grain 4"}};
  /// Has a work-item do so many times the work that suits most devices. Takes effect where there is more than
  /// one way to cut the work, and changes nothing of what is found.
  virtual void set_grain(double /*grain*/) {}
  /// How many pieces a search is cut into, as far as the grain decides.
  [[nodiscard]] virtual std::size_t pieces(const Search& /*search*/) const { return 1; }

  /// Enqueues what puts every pair that was none in the last update to the sink, each once. May be called
  /// again for the same search, where the sink was too small.
  /// @throws cl::Error, Error
  virtual void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) = 0;
  /// The changes of the search are there. Not called where it failed.
  /// @param seconds What the update has taken of its caller's time.
  virtual void ended(double /*seconds*/) {}
};

}  // namespace broadcl
