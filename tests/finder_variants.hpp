#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <ostream>

#include "engines/algorithm.hpp"
#include "engines/pair_finder.hpp"
#include "opencl/context.hpp"

namespace broadcl::test {

/// Uses the two finders in turn, one per search.
class Turns final : public PairFinder {
 public:
  explicit Turns(const opencl::Context& context) : finders_{make_brute_force(context), make_tiles(context)} {}

  void begin(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    turn_ = 1 - turn_;
    finders_.at(turn_)->begin(search, sink, profiler);
  }
  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(turn_)->build(search, sink, profiler);
  }
  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(turn_)->find(search, sink, profiler);
  }
  [[nodiscard]] bool keeps(const Search& search, const PairDelta& sink) const override {
    return finders_.at(turn_)->keeps(search, sink);
  }
  [[nodiscard]] bool gave_up(const PairDelta::Counts& counts) override {
    return finders_.at(turn_)->gave_up(counts);
  }
  void rebuild(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(turn_)->rebuild(search, sink, profiler);
  }
  void forget() noexcept override {
    for (const auto& finder : finders_) finder->forget();
  }

 private:
  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  std::size_t turn_ = 0;
};

inline std::unique_ptr<PairFinder> make_turns(const opencl::Context& context) {
  return std::make_unique<Turns>(context);
}

inline constexpr std::size_t never_early = std::numeric_limits<std::size_t>::max();

/// A way to find pairs on the device that a scene has to be large for, or that only tests have.
struct FinderVariant {
  const char* name;
  MakePairFinder make;
};
inline constexpr std::array finder_variants{
    FinderVariant{"TilesSortedInEachFrame",
                  [](const opencl::Context& context) { return make_tiles(context, -1, never_early); }},
    FinderVariant{"TilesSortedOnce",
                  [](const opencl::Context& context) {
                    return make_tiles(context, std::numeric_limits<double>::infinity(), never_early);
                  }},
    FinderVariant{"TilesSearchedEarly",
                  [](const opencl::Context& context) { return make_tiles(context, 3, 1); }},
    FinderVariant{"TilesAndBruteForceInTurn", make_turns}};

inline std::ostream& operator<<(std::ostream& out, const FinderVariant& variant) {
  return out << variant.name;
}

}  // namespace broadcl::test
