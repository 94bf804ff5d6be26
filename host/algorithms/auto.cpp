#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <string_view>

#include "algorithms/algorithm.hpp"
#include "algorithms/calibration.hpp"
#include "algorithms/chooser.hpp"
#include "algorithms/pair_finder.hpp"

namespace broadcl {
namespace {

constexpr std::array<std::string_view, 2> names{"brute-force", "tiles"};

/// What decides: brute force tests all pairs, of which one object at least changed; tiles cost something for
/// each slot, and more for those that changed. (Orders of magnitude: what they are is measured.)
constexpr std::array contestants{Contestant{make_brute_force, {.frame = 1e-4, .slot = 1e-9, .test = 1e-12}},
                                 Contestant{make_tiles, {.frame = 1e-4, .slot = 1e-9, .change = 1e-9}}};

/// The one of two that is expected to be cheaper, search by search. A stage of its name tells which it was,
/// and one after it with which grain.
class Auto final : public PairFinder {
 public:
  explicit Auto(const opencl::Context& context) : Auto(context, calibrate(context, contestants)) {}

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    is_first_ = !is_searching_;
    is_searching_ = true;
    const std::size_t chosen = chooser_.choose({.slots = search.slots,
                                                .changed = search.all ? search.slots : search.changed_count,
                                                .all = search.all});
    for (const std::string_view choice : {names[chosen], grains_[chosen]}) {
      const opencl::Profiler::Scope stage(profiler, choice);
    }
    finders_[chosen]->find(search, sink, profiler);
  }

  void ended(double seconds) override {
    // One that was repeated with a larger sink, or came after a failure, says nothing about the next.
    if (is_first_) chooser_.learn(seconds);
    is_searching_ = false;
  }

 private:
  Auto(const opencl::Context& context, const std::array<Calibration, 2>& calibrations)
      : finders_{make_brute_force(context), make_tiles(context)},
        chooser_({calibrations[0].model, calibrations[1].model}) {
    for (std::size_t k = 0; k < finders_.size(); ++k) {
      const double grain = calibrations[k].grain;
      finders_[k]->set_grain(grain);
      const auto* const known = std::ranges::find(PairFinder::grains, grain, &PairFinder::Grain::factor);
      grains_[k] = known != PairFinder::grains.end() ? known->name : "BROADCL_GRAIN";
    }
  }

  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  std::array<std::string_view, 2> grains_;
  Chooser chooser_;
  bool is_searching_ = false;
  bool is_first_ = false;  // the search that is on is no repetition
};

}  // namespace

std::unique_ptr<PairFinder> make_auto(const opencl::Context& context) {
  return std::make_unique<Auto>(context);
}

}  // namespace broadcl
