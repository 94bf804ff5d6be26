#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "engines/hybrid.hpp"
#include "engines/pair_finder.hpp"
#include "finders/calibration.hpp"

namespace broadcl {
namespace {

constexpr std::array<std::string_view, 2> finder_names{"brute-force", "tiles"};
constexpr std::array<MakePairFinder, 2> both_finders{make_brute_force, make_tiles};

/// Switch only if the other finder is expected to take less than this share of the current one's time.
constexpr double clearly_less = 0.95;

/// With up to this many slots, `brute-force` is the better choice on every CPU.
constexpr std::size_t small_on_cpu = 400;

/// A GPU is opened for updates that take longer, in seconds: if it is named, about as long as the fastest
/// update on any GPU; otherwise several times that, since opening it takes time and memory.
constexpr double slow_if_named = 30e-6;
constexpr double slow_otherwise = 100e-6;

/// Chooses in each frame the finder that is expected to take less time, by cost models of the device and by
/// the work that each finder expects. A stage with the finder's name says which one it was.
class Auto final : public PairFinder {
 public:
  explicit Auto(const opencl::Context& context)
      : context_(context), finders_{make_brute_force(context), nullptr} {
    if (context.tuning() != opencl::Tuning::cpu || context.device().type != DeviceType::cpu) compare();
  }

  void warm_up(std::size_t slots) override {
    if (slots > small_on_cpu) compare();
  }

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    choose(search, sink);
    finders_.at(chosen_)->build(search, sink, profiler);
  }

  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    { const opencl::Profiler::Scope stage(profiler, finder_names.at(chosen_)); }
    finders_.at(chosen_)->find(search, sink, profiler);
  }

  [[nodiscard]] bool keeps(const Search& search, const PairDelta& sink) const override {
    return finders_.at(chosen_)->keeps(search, sink);
  }

  [[nodiscard]] bool gave_up(const PairDelta::Counts& counts) override {
    return finders_.at(chosen_)->gave_up(counts);
  }

  void rebuild(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    finders_.at(chosen_)->rebuild(search, sink, profiler);
  }

  void forget() noexcept override {
    for (const auto& finder : finders_) {
      if (finder) finder->forget();
    }
  }

  [[nodiscard]] double expected_work(const Search& search, const PairDelta& sink) override {
    return finders_.at(chosen_)->expected_work(search, sink);
  }

  /// As if no boxes overlapped. What tiles find depends on where the boxes are.
  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t changed) const override {
    const bool all = changed == slots;
    const auto tests = static_cast<double>(slots) * static_cast<double>(changed) * (all ? 0.5 : 1);
    return std::min(models_[0].seconds(slots, all, tests), models_[1].seconds(slots, all, 0));
  }

 private:
  /// Makes the second finder, and compares the two.
  void compare() {
    if (finders_[1]) return;
    const auto models = calibrate(context_, both_finders);
    finders_[1] = make_tiles(context_);
    models_ = models;
  }

  void choose(const Search& search, const PairDelta& sink) {
    if (!finders_[1]) return;
    const std::size_t other = 1 - chosen_;
    if (seconds(other, search, sink) < clearly_less * seconds(chosen_, search, sink)) chosen_ = other;
  }

  [[nodiscard]] double seconds(std::size_t which, const Search& search, const PairDelta& sink) const {
    const double work = finders_.at(which)->expected_work(search, sink);
    return models_.at(which).seconds(search.now.slots, search.all, work);
  }

  const opencl::Context& context_;
  std::array<CostModel, 2> models_{};  // 0 until they are measured
  std::array<std::unique_ptr<PairFinder>, 2> finders_;
  std::size_t chosen_ = 0;
};

}  // namespace

std::unique_ptr<PairFinder> make_auto(const opencl::Context& context) {
  return std::make_unique<Auto>(context);
}

AlgorithmPointer make_auto(const Config& config) {
  const bool is_named = names_device(config);
  if (is_named && device_for(config)) return make_device_algorithm(config, make_auto);
  const auto open = [config, is_named]() -> AlgorithmPointer {
    try {
      if (select_device(config.device).type == DeviceType::cpu) return nullptr;
      return make_device_algorithm(config, make_auto);
    } catch (const Error&) {
      if (is_named) throw;
      return nullptr;
    }
  };
  return make_hybrid(make_sweep_and_prune(config), open, is_named ? slow_if_named : slow_otherwise);
}

}  // namespace broadcl
