#include <algorithm>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "failing_opencl.hpp"
#include "pair_lists.hpp"

namespace broadcl {
namespace {

using test::EachAlgorithm;
using test::FailingOpenCl;

/// Objects that are added, moved, filtered and removed, by calls each of which is made again where it fails.
class Life {
 public:
  Life(const BroadPhase::Config& config, int attempts) : broad_phase_(config), attempts_(attempts) {}

  /// @returns Whether every call succeeded in the end.
  bool live() {
    for (int frame = 0; frame < 5; ++frame) {
      bool lives = change() && (frame % 2 == 0 || (attempt([&] { broad_phase_.begin(); }) && change()));
      lives = lives && attempt([&] {
                const Delta delta = broad_phase_.finish();
                known_ = merge(difference(known_, delta.removed), delta.added);
              });
      if (!lives) return false;
      EXPECT_TRUE(test::same("pairs", known_, expected())) << "frame " << frame;
    }
    std::vector<Pair> pairs;
    if (!attempt([&] { pairs = broad_phase_.pairs(); })) return false;
    EXPECT_TRUE(test::same("all", pairs, known_));
    return true;
  }

 private:
  template <class Function>
  [[nodiscard]] bool attempt(const Function& function) const {
    for (int k = 0; k < attempts_; ++k) {
      try {
        function();
        return true;
      } catch (const Error&) {
        continue;
      }
    }
    return false;
  }

  bool change() {
    std::uniform_real_distribution<float> place(0, 6);
    for (int k = 0; k < 12; ++k) {
      const float x = place(random_);
      const Aabb box{{x, 0, 0}, {x + 1, 1, 1}};
      std::uint32_t id = 0;
      if (!attempt([&] { id = broad_phase_.add(box); })) return false;
      if (id == boxes_.size()) boxes_.emplace_back();
      boxes_[id] = box;
    }
    for (std::uint32_t id = 0; id < boxes_.size(); id += 3) {
      if (is_empty(boxes_[id])) continue;
      boxes_[id].upper[0] += 1;
      if (!attempt([&] { broad_phase_.move(id, boxes_[id]); })) return false;
    }
    for (std::uint32_t id = 1; id < boxes_.size(); id += 7) {
      if (is_empty(boxes_[id])) continue;
      boxes_[id] = empty_aabb();
      if (!attempt([&] { broad_phase_.remove(id); })) return false;
    }
    return true;
  }

  [[nodiscard]] std::vector<Pair> expected() const {
    std::vector<Pair> pairs;
    for (std::uint32_t b = 0; b < boxes_.size(); ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        if (overlaps(boxes_[a], boxes_[b])) pairs.push_back({a, b});
      }
    }
    return pairs;
  }

  BroadPhase broad_phase_;
  int attempts_;
  std::vector<Aabb> boxes_;
  std::vector<Pair> known_;
  std::mt19937 random_{1};  // NOLINT(bugprone-random-generator-seed): the same life each time
};

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachAlgorithm, ACallThatFailsMayBeRepeated) {
  for (long first = 0, calls = 1; first < calls; first += is_slow() ? 15 : 3) {
    SCOPED_TRACE("call " + std::to_string(first));
    Life life(config(), 2);
    const FailingOpenCl one_fails(first, 1);
    ASSERT_TRUE(life.live());
    calls = FailingOpenCl::calls();
  }
}

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(EachAlgorithm, ADeviceThatFailsForGoodIsAnErrorEachTime) {
  bool failed = true;
  for (long first = 0; failed; first += is_slow() ? 35 : 7) {
    SCOPED_TRACE("from call " + std::to_string(first) + " on");
    std::optional<Life> life(std::in_place, config(), 3);
    const FailingOpenCl all_fail(first, 1'000'000);
    failed = !life->live();
    EXPECT_EQ(failed, FailingOpenCl::calls() > first);
    life.reset();  // while calls fail
  }
}

}  // namespace
}  // namespace broadcl
