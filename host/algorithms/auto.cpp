#include <array>
#include <chrono>
#include <memory>
#include <string_view>

#include "algorithms/algorithm.hpp"
#include "algorithms/chooser.hpp"
#include "algorithms/pair_finder.hpp"

namespace broadcl {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::array<std::string_view, 2> names{"brute-force", "tiles"};

/// As measured on a CPU with 2 compute units (PoCL) and on a GPU with 132 (H200); what is not paid once a
/// frame is taken to be shared among them.
std::array<CostModel, 2> models(const opencl::Context& context) {
  const bool is_cpu = context.shape() == opencl::Shape::cpu;
  const double units = context.device().compute_units / (is_cpu ? 2.0 : 132.0);
  if (is_cpu) return {CostModel{1e-4, 50e-9 / units, 0.09e-9 / units}, CostModel{1e-4, 150e-9 / units, 0}};
  return {CostModel{40e-6, 0.7e-9 / units, 0.5e-12 / units}, CostModel{66e-6, 1.25e-9 / units, 0}};
}

/// The one of two that is expected to be cheaper, search by search. A stage of its name tells which it was.
class Auto final : public PairFinder {
 public:
  explicit Auto(const opencl::Context& context)
      : finders_{make_brute_force(context), make_tiles(context)}, chooser_(models(context)) {}

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    is_first_ = !is_searching_;
    is_searching_ = true;
    const std::size_t chosen = chooser_.choose({.slots = search.slots,
                                                .changed = search.all ? search.slots : search.changed_count,
                                                .all = search.all});
    { const opencl::Profiler::Scope stage(profiler, names[chosen]); }
    start_ = Clock::now();
    finders_[chosen]->find(search, sink, profiler);
  }

  void ended() override {
    // One that was repeated with a larger sink, or came after a failure, says nothing about the next.
    if (is_first_) chooser_.learn(std::chrono::duration<double>(Clock::now() - start_).count());
    is_searching_ = false;
  }

 private:
  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  Chooser chooser_;
  bool is_searching_ = false;
  bool is_first_ = false;  // the search that is on is no repetition
  Clock::time_point start_;
};

}  // namespace

std::unique_ptr<PairFinder> make_auto(const opencl::Context& context) {
  return std::make_unique<Auto>(context);
}

}  // namespace broadcl
