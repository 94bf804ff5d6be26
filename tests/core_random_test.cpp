// Random calls of a BroadPhase: whatever the calls and their order, each algorithm, on the host, on the
// device or changing between the two, reports what follows from the definitions. How to repeat a failed run:
// docs/testing.md.
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "core/core.hpp"
#include "core_player.hpp"
#include "core_random_script.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "engines/hybrid.hpp"
#include "finder_variants.hpp"
#include "pretender.hpp"
#include "random_scripts.hpp"
#include "test_name.hpp"
#include "warped.hpp"

namespace broadcl::test {
namespace {

void play_to_algorithm(const BroadPhase::Config& config, ScriptSize size, std::size_t scripts,
                       std::optional<std::uint64_t> seed) {
  check_core_scripts(config.algorithm, size, scripts, seed,
                     [&] { return std::make_unique<BroadPhase>(config); });
}

TEST_P(EachAlgorithm, SomeRandomCalls) {
  const std::size_t scripts = (GetParam().on_device ? 20U : 60U) / (is_sanitized ? 2 : 1);
  const bool is_slow = GetParam().on_device && is_slow_device();
  play_to_algorithm(config(), ScriptSize::small, is_slow ? 3 : scripts, seed_of_ci);
}

/// In double precision, which single precision can seldom tell.
TEST_P(EachAlgorithm, SomeRandomCallsInDoublePrecision) {
  const std::size_t scripts = GetParam().on_device ? 10 : 40;
  check_core_scripts(config().algorithm, ScriptSize::small, is_slow() ? 2 : scripts, seed_of_ci,
                     [] { return std::make_unique<Warped<BroadPhase64>>(config()); });
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallRandomCalls) {
  play_to_algorithm(config(), ScriptSize::tiny, 5, seed_of_ci);
}

/// The oracle, with which others are compared in large scenes, follows the definitions.
NOT_IN(sanitizers, "takes long in the reference; sweep-and-prune's calls are in it");
TEST(Oracle, SomeRandomCalls) {
  play_to_algorithm({.algorithm = "oracle"}, ScriptSize::small, 60, seed_of_ci);
}

TEST(Long, RandomCalls) {
  for (const AlgorithmInfo& info : algorithms()) {
    const BroadPhase::Config config{.algorithm = std::string(info.name)};
    play_to_algorithm(config, ScriptSize::small, 2000, std::nullopt);
    check_core_scripts(config.algorithm, ScriptSize::small, 1000, std::nullopt,
                       [&] { return std::make_unique<Warped<BroadPhase64>>(config); });
  }
}

class RandomVariant : public ::testing::TestWithParam<FinderVariant> {
 protected:
  static void play(std::size_t scripts, std::optional<std::uint64_t> seed) {
    check_core_scripts(GetParam().name, ScriptSize::small, scripts, seed, [] {
      return std::make_unique<Core<Aabb>>(make_device_algorithm({}, GetParam().make));
    });
  }
};
SUITE_ALSO_IN(RandomVariant, gpu_profile | rusticl);
INSTANTIATE_TEST_SUITE_P(Device, RandomVariant, ::testing::ValuesIn(finder_variants), named_by_parameter);

TEST_P(RandomVariant, SomeRandomCalls) {
  play(is_slow_device() ? 3 : 20, seed_of_ci);
}

using LongRandomVariant = RandomVariant;
INSTANTIATE_TEST_SUITE_P(Long, LongRandomVariant, ::testing::ValuesIn(finder_variants), named_by_parameter);

TEST_P(LongRandomVariant, ManyRandomCalls) {
  play(2000, std::nullopt);
}

/// Changes between the host and what it takes for a device whenever the script says so.
/// @tparam Subject Core, or one with the same functions.
template <class Subject>
class Changeable {
 public:
  explicit Changeable(std::string_view algorithm)
      : core_(make_hybrid(
            make_algorithm({.algorithm = "sweep-and-prune"}),
            [this, algorithm] { return std::make_unique<Pretender>(orders_, algorithm); }, 0, 1,
            [this] { return clock_ += std::chrono::microseconds(10); })) {
    const std::uint32_t id = core_.add(unit, Filter());
    for (std::size_t k = 1; core_.algorithm().memory().device == 0; ++k) {  // until the device is opened
      core_.move(id, apart(k % 2));
      (void)core_.finish();
      std::this_thread::yield();
    }
    core_.remove(id);
    (void)core_.finish();
  }

  /// Makes the device faster than the host, or slower if it is faster.
  void change_side() {
    is_fast_ = !is_fast_;
    orders_.expected_seconds = is_fast_ ? 0 : 1e-3;
    orders_.takes = std::chrono::milliseconds(is_fast_ ? 0 : 1);
  }
  void set_failing(bool fails) { orders_.fails = fails ? "touching" : ""; }
  [[nodiscard]] Subject& core() { return core_; }

 private:
  Time clock_;
  Pretender::Orders orders_{.clock = &clock_};
  bool is_fast_ = false;
  Subject core_;
};

template <class Subject>
void play_to_hybrid(std::string_view device, std::size_t scripts) {
  std::size_t changes = 0;
  check_scripts("auto with " + std::string(device), scripts, seed_of_ci, [&] {
    const CoreScript script = *core_scripts(ScriptSize::small);
    Changeable<Subject> subject(device);
    CorePlayer player(subject.core(), script);
    bool was_on_device = false;
    apply_each(script.ops, [&](const CoreOp& op) {
      if (op.verb == CoreVerb::change_side) subject.change_side();
      if (op.verb == CoreVerb::fail) {
        subject.set_failing(true);
        player.fail_to_update(op);
        subject.set_failing(false);
      }
      player.apply(op);
      const bool is_on_device = subject.core().algorithm().device() != nullptr;
      if (std::exchange(was_on_device, is_on_device) != is_on_device) ++changes;
    });
    player.end();
  });
  if (!::testing::Test::HasFailure() && !is_reproduced()) {
    EXPECT_GT(changes, 2 * scripts);
  }
}

/// Updates fail that the algorithm has already done.
void play_to_failing(std::string_view algorithm) {
  std::size_t failures = 0;
  check_scripts("failing " + std::string(algorithm), 40, seed_of_ci, [&] {
    const CoreScript script = *core_scripts(ScriptSize::small);
    Pretender::Orders orders;
    Warped<Core<Aabb64>> subject(std::make_unique<Pretender>(orders, algorithm));
    CorePlayer player(subject, script);
    apply_each(script.ops, [&](const CoreOp& op) {
      if (op.verb != CoreVerb::fail) return player.apply(op);
      orders.fails = "touching";
      player.fail_to_update(op);
      orders.fails.clear();
    });
    player.end();
    failures += player.failures();
  });
  if (!::testing::Test::HasFailure() && !is_reproduced()) {
    EXPECT_GT(failures, 40U);
  }
}

TEST(RandomFailure, OfTheComparisonInDoublePrecision) {
  for (const std::string_view algorithm : {"oracle", "sweep-and-prune", "tiles"}) play_to_failing(algorithm);
}

class RandomHybrid : public ::testing::TestWithParam<std::string_view> {};

TEST_P(RandomHybrid, SomeRandomCalls) {
  play_to_hybrid<Core<Aabb>>(GetParam(), 20);
}

TEST_P(RandomHybrid, SomeRandomCallsInDoublePrecision) {
  play_to_hybrid<Warped<Core<Aabb64>>>(GetParam(), 10);
}

INSTANTIATE_TEST_SUITE_P(Device, RandomHybrid, ::testing::Values("oracle", "brute-force", "tiles"),
                         named_by_parameter);

}  // namespace
}  // namespace broadcl::test
