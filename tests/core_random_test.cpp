// Random calls of a BroadPhase: whatever the calls and their order, each algorithm, on the host, on the
// device or changing between the two, reports what follows from the definitions. How to repeat a failed run:
// docs/testing.md.
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "algorithms/algorithm.hpp"
#include "algorithms/hybrid.hpp"
#include "core.hpp"
#include "core_random_script.hpp"
#include "each_algorithm.hpp"
#include "pretender.hpp"
#include "random_scripts.hpp"
#include "reference.hpp"
#include "rounding.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

/// Plays a script to a broad phase and the reference.
/// @tparam Subject BroadPhase, or the Core of one.
template <class Subject>
class CorePlayer {
 public:
  CorePlayer(Subject& subject, const CoreScript& script) : subject_(subject), script_(script) {}

  /// In a rounding mode that depends on the operation.
  void apply(const CoreOp& op) {
    const ScopedRounding rounding(rounding_modes.at(op.which % rounding_modes.size()));
    const std::vector<std::uint32_t> ids = reference_.ids();
    switch (op.verb) {
      case CoreVerb::add:
        for (unsigned k = 0; k < op.count && reference_.size() < script_.most; ++k) {
          add(box_of(script_, op, k), filter_of(script_, op, k));
        }
        break;
      case CoreVerb::map:
        map(op);
        break;
      case CoreVerb::exclude: {
        const Pairs pairs = exclusions_of(op, reference_.pairs());
        subject_.set_exclusions(pairs);
        reference_.set_exclusions(pairs);
        break;
      }
      case CoreVerb::begin:
        subject_.begin();
        reference_.begin();
        break;
      case CoreVerb::update:
        update();
        break;
      case CoreVerb::shrink:
        if (reference_.is_in_flight()) {
          require_error("between begin() and finish()", [&] { subject_.shrink(); });
        } else {
          subject_.shrink();
        }
        break;
      case CoreVerb::refuse:
        refuse(op);
        break;
      case CoreVerb::enqueue:
      case CoreVerb::change_side:
        break;
      default:
        for (unsigned k = 0; k < op.count && k < ids.size(); ++k) {
          apply_to(ids[(op.which + k) % ids.size()], op, k);
        }
    }
    if (subject_.size() != reference_.size()) fail("another size");
  }

  void update() {
    const Delta delta = subject_.finish();
    const Reference::Changes expected = reference_.finish();
    require(same(delta, expected.added, expected.removed));
    require(same("pairs", subject_.pairs(), reference_.pairs()));
  }

 private:
  void add(const Aabb& box, const Filter& filter) {
    if (has_nan(box)) return require_error("NaN", [&] { subject_.add(box, filter); });
    if (subject_.add(box, filter) != reference_.add(box, filter))
      fail("the new id is not the lowest free one");
  }

  /// An operation on one object that exists.
  void apply_to(std::uint32_t id, const CoreOp& op, unsigned k) {
    if (op.verb == CoreVerb::move) {
      const Aabb box = box_of(script_, op, k);
      if (has_nan(box)) return require_error("NaN", [&] { subject_.move(id, box); });
      subject_.move(id, box);
      reference_.move(id, box);
    } else if (op.verb == CoreVerb::filter) {
      const Filter filter = filter_of(script_, op, k);
      subject_.set_filter(id, filter);
      reference_.set_filter(id, filter);
    } else {
      const Aabb box = reference_.box(id);
      const Filter filter = reference_.filter(id);
      subject_.remove(id);
      reference_.remove(id);
      if (op.verb == CoreVerb::replace) add(box, filter);
    }
  }

  /// Writes all boxes or some, and one with a NaN before the right one.
  void map(const CoreOp& op) {
    const std::size_t n = op.count > 1 ? std::min(op.count, script_.most) : reference_.size();
    if (reference_.is_in_flight()) {
      return require_error("between begin() and finish()", [&] { (void)subject_.map(n); });
    }
    const std::span<Aabb> boxes = subject_.map(n);
    reference_.map(n);
    if (n == 0) return;
    const std::uint32_t invalid = op.which % static_cast<std::uint32_t>(n);
    const Aabb before = boxes[invalid];
    boxes[invalid].lower[op.which % 3] = nan_value;
    require_error("box " + std::to_string(invalid), [&] { subject_.begin(); });
    boxes[invalid] = before;
    for (std::uint32_t k = 0; k < n; k += 1 + op.which % 3) {
      const Aabb box = box_of(script_, op, k);
      if (has_nan(box)) continue;
      boxes[k] = box;
      reference_.move(k, box);
    }
  }

  void refuse(const CoreOp& op) {
    std::uint32_t unknown = 0;
    for (const std::uint32_t id : reference_.ids()) unknown += id == unknown ? 1U : 0U;
    if (op.which % 2 == 0) unknown += script_.most;
    const auto of_unknown = [&](const auto& function) { require_error("no object has the id", function); };
    of_unknown([&] { subject_.move(unknown, unit); });
    of_unknown([&] { subject_.remove(unknown); });
    of_unknown([&] { subject_.set_filter(unknown, filter_of(script_, op, 0)); });
    const Pairs of_itself{{0, 1}, {op.which, op.which}};
    require_error("and itself", [&] { subject_.set_exclusions(of_itself); });
    if (reference_.is_in_flight()) require_error("finish()", [&] { (void)subject_.pairs(); });
  }

  Subject& subject_;
  const CoreScript& script_;
  Reference reference_;
};

void play_to_algorithm(const BroadPhase::Config& config, ScriptSize size, std::size_t scripts,
                       std::optional<std::uint64_t> seed) {
  check_scripts(config.algorithm, scripts, seed, [&] {
    const CoreScript script = *core_scripts(size);
    BroadPhase broad_phase(config);
    CorePlayer player(broad_phase, script);
    apply_each(script.ops, [&](const CoreOp& op) { player.apply(op); });
    player.update();
  });
}

/// On a device few, because to create an object takes as long as its script.
TEST_P(EachAlgorithm, SomeRandomCalls) {
  const std::size_t scripts = GetParam().on_device ? 10 : 150;
  play_to_algorithm(config(), ScriptSize::small, is_slow() ? 3 : scripts, seed_of_ci);
}

ALSO_IN(oclgrind);
TEST_P(EachAlgorithm, SmallRandomCalls) {
  play_to_algorithm(config(), ScriptSize::tiny, 3, seed_of_ci);
}

TEST(Long, RandomCalls) {
  for (const AlgorithmInfo& info : algorithms()) {
    play_to_algorithm({.algorithm = std::string(info.name)}, ScriptSize::small, 2000, std::nullopt);
  }
}

/// Changes between the host and what it takes for a device whenever the script says so.
class Changeable {
 public:
  explicit Changeable(std::string_view algorithm)
      : core_(make_hybrid(
            make_algorithm({.algorithm = "sweep-and-prune"}),
            [this, algorithm] { return std::make_unique<Pretender>(orders_, algorithm); }, 0,
            [this] { return clock_ += std::chrono::microseconds(10); })) {
    const std::uint32_t id = core_.add(unit, {});
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
  [[nodiscard]] Core& core() { return core_; }

 private:
  Time clock_;
  Pretender::Orders orders_{.clock = &clock_};
  bool is_fast_ = false;
  Core core_;
};

class RandomHybrid : public ::testing::TestWithParam<std::string_view> {};

TEST_P(RandomHybrid, SomeRandomCalls) {
  constexpr std::size_t scripts = 10;
  std::size_t changes = 0;
  check_scripts("auto with " + std::string(GetParam()), scripts, seed_of_ci, [&] {
    const CoreScript script = *core_scripts(ScriptSize::small);
    Changeable subject(GetParam());
    CorePlayer player(subject.core(), script);
    bool was_on_device = false;
    apply_each(script.ops, [&](const CoreOp& op) {
      if (op.verb == CoreVerb::change_side) subject.change_side();
      player.apply(op);
      const bool is_on_device = subject.core().algorithm().device() != nullptr;
      if (std::exchange(was_on_device, is_on_device) != is_on_device) ++changes;
    });
    player.update();
  });
  if (!HasFailure() && !is_reproduced()) {
    EXPECT_GT(changes, 2 * scripts);
  }
}

INSTANTIATE_TEST_SUITE_P(Device, RandomHybrid, ::testing::Values("oracle", "tiles"), named_by_parameter);

}  // namespace
}  // namespace broadcl::test
