#include <algorithm>
#include <cstddef>
#include <memory>

#include "base/hysteresis.hpp"
#include "base/system.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "engines/hybrid.hpp"
#include "engines/pair_finder.hpp"

namespace broadcl {
namespace {

/// The cost, in tests, of finding out whether boxes that overlap are a new pair; 70 to 190 on PoCL 3.1.
constexpr double tests_per_hit = 100;

/// What a change of the finder costs, as a share of these tests.
constexpr double change = 0.1;

/// A GPU is opened for updates that take longer, in seconds: if it is named, about as long as the fastest
/// update on any GPU; otherwise several times that, since opening it takes time and memory.
constexpr double slow_if_named = 30e-6;
constexpr double slow_otherwise = 100e-6;

/// Chooses in each frame between two finders.
class Auto final : public PairFinder {
 public:
  explicit Auto(const opencl::Context& context)
      : context_(context),
        brute_force_(make_brute_force(context)),
        tiles_(make_tiles(context)),
        chosen_(brute_force_.get()) {}

  void begin(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    chosen_ = choose(search, sink);
    chosen_->begin(search, sink, profiler);
  }

  void build(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    chosen_->build(search, sink, profiler);
  }

  /// A stage with the finder's name says which one it was.
  void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    { const opencl::Profiler::Scope stage(profiler, chosen_ == tiles_.get() ? "tiles" : "brute-force"); }
    chosen_->find(search, sink, profiler);
  }

  [[nodiscard]] bool keeps(const Search& search, const PairDelta& sink) const override {
    return chosen_->keeps(search, sink);
  }

  [[nodiscard]] bool gave_up(const PairDelta::Counts& counts) override { return chosen_->gave_up(counts); }

  void rebuild(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) override {
    chosen_->rebuild(search, sink, profiler);
  }

  void forget() noexcept override {
    brute_force_->forget();
    tiles_->forget();
  }

  /// Roughly what a large GPU takes. (Updates that were measured correct it.)
  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t /*changed*/) const override {
    return 30e-6 + 1e-9 * static_cast<double>(slots);
  }

 private:
  /// The pairs that `brute-force` may have to test, at most, to be used.
  [[nodiscard]] double most_tests(std::size_t slots) const {
    const opencl::LaunchParameters& launch = context_.launch();
    return context_.device().compute_units *
           (launch.auto_tests + launch.auto_tests_per_slot * static_cast<double>(slots));
  }

  PairFinder* choose(const Search& search, const PairDelta& sink) {
    if (search.worlds) return tiles_.get();  // (`brute-force` also tests boxes of different worlds)
    const double most = most_tests(search.now.slots);
    const double more = tests(search, sink) - most;
    const bool is_brute_force = chosen_ == brute_force_.get();
    const bool changes = rule_.must_change(is_brute_force ? more : -more, change * most);
    return is_brute_force != changes ? brute_force_.get() : tiles_.get();
  }

  /// The pairs that `brute-force` would test; those that overlap count more.
  [[nodiscard]] static double tests(const Search& search, const PairDelta& sink) {
    const auto slots = static_cast<double>(search.now.slots);
    const double share =
        search.changed.all || slots == 0 ? 1 : std::min(1.0, 2 * search.changed.count / slots);
    return slots * search.changed_slots() * (search.changed.all ? 0.5 : 1) +
           tests_per_hit * share * static_cast<double>(sink.pair_count());
  }

  const opencl::Context& context_;
  std::unique_ptr<PairFinder> brute_force_;
  std::unique_ptr<PairFinder> tiles_;
  PairFinder* chosen_;
  Hysteresis rule_;  // that chooses it
};

}  // namespace

std::unique_ptr<PairFinder> make_auto(const opencl::Context& context) {
  return std::make_unique<Auto>(context);
}

AlgorithmPointer make_auto(const Config& config) {
  const bool is_named = names_device(config);
  if (is_named && device_for(config)) return make_device_algorithm(config, make_auto);
  const OpenDevice open = [config, is_named]() -> AlgorithmPointer {
    try {
      if (select_device(config.device).type == DeviceType::cpu) return nullptr;
      return make_device_algorithm(config, make_auto);
    } catch (const Error&) {
      if (is_named) throw;
      return nullptr;
    }
  };
  // Asking OpenCL for devices loads all drivers, for the rest of the process.
  static const bool has_gpu = may_have_gpu();
  const Threads threads(config);
  return make_hybrid(make_sweep_and_prune(threads), is_named || has_gpu ? open : OpenDevice(),
                     is_named ? slow_if_named : slow_otherwise, threads);
}

}  // namespace broadcl
