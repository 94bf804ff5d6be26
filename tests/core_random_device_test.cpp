// Random calls of a DeviceBroadPhase: core_random_test.cpp does the same with a BroadPhase.
#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/opencl.hpp>

#include "core_random_script.hpp"
#include "device_twins.hpp"
#include "each_algorithm.hpp"
#include "random_scripts.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

/// Plays a script to DeviceTwins. If the filters divide the objects into two sets, the first objects are the
/// first set.
class DevicePlayer {
 public:
  DevicePlayer(const CallersQueue& queue, const std::string& algorithm, const CoreScript& script)
      : script_(script), twins_(queue, {.algorithm = algorithm}) {
    frame_.worlds = script.filters > FilterKind::groups;
    if (script.filters == FilterKind::sets || script.filters == FilterKind::sets_of_worlds) {
      frame_.first_count = 1 + script.most / 3;
      frame_.boxes.assign(*frame_.first_count, inverted);
    }
    resize_filters();
    reserve();
  }

  void apply(const CoreOp& op) {
    switch (op.verb) {
      case CoreVerb::add:
        for (unsigned k = 0; k < op.count && frame_.boxes.size() < most(); ++k) add(op, k);
        break;
      case CoreVerb::map:
        frame_.gap = op.which % 3;
        frame_.worlds = script_.filters > FilterKind::groups && op.which % 4 != 0;  // only for speed
        if (op.count > 1) resize(op);
        break;
      case CoreVerb::drift:
        for (unsigned k = 0; k < op.count && !twins_.is_in_flight(); ++k) {
          drift(script_, op, frame_.boxes, 1);
          op.which % 2 == 0 ? update() : enqueue(2);
        }
        break;
      case CoreVerb::stir:
        for (unsigned k = 0; k < op.count && !twins_.is_in_flight(); ++k) {
          const std::vector<Aabb> before = frame_.boxes;
          for (std::size_t box = 0; box < before.size(); ++box) {
            frame_.boxes[box] = stirred(script_, op, k, before, box).value_or(before[box]);
          }
          update();
        }
        break;
      case CoreVerb::exclude: {
        const Pairs pairs = exclusions_of(op, twins_.reference().pairs());
        if (twins_.is_in_flight())
          return require_error("finish()", [&] { twins_.tested().set_exclusions(pairs); });
        twins_.set_exclusions(pairs);
        break;
      }
      case CoreVerb::begin:
        if (!twins_.is_in_flight()) twins_.begin(frame_);
        break;
      case CoreVerb::update:
        if (op.which % 5 == 0) frame_.ordered_worlds = 3;
        update();
        break;
      case CoreVerb::enqueue:
        if (!twins_.is_in_flight()) enqueue(op.which % 3);
        break;
      case CoreVerb::shrink:
        if (twins_.is_in_flight()) return require_error("finish()", [&] { twins_.tested().shrink(); });
        twins_.shrink();
        reserve();
        break;
      case CoreVerb::refuse:
        refuse();
        break;
      case CoreVerb::change_side:
      case CoreVerb::ask:
      case CoreVerb::partners:
      case CoreVerb::save:
      case CoreVerb::restore:
        break;
      default:
        for (unsigned k = 0; k < op.count && !frame_.boxes.empty(); ++k) {
          apply_to((op.which + k) % frame_.boxes.size(), op, k);
        }
    }
  }

  void update() {
    if (!twins_.is_in_flight()) twins_.begin(frame_);
    require(twins_.finish());
    frame_.ordered_worlds = 0;
  }

 private:
  [[nodiscard]] std::uint32_t most() const { return script_.most + script_.most / 3 + 1; }
  void reserve() { twins_.reserve(most(), most() * most() / 2); }
  void resize_filters() {
    if (script_.filters != FilterKind::none) frame_.filters.resize(frame_.boxes.size());
  }

  void add(const CoreOp& op, unsigned call) {
    frame_.boxes.push_back(box_of(script_, op, call));
    resize_filters();
    if (!frame_.filters.empty()) frame_.filters.back() = filter_of(script_, op, call);
  }

  void resize(const CoreOp& op) {
    const std::size_t n = frame_.first_count.value_or(0) + mapped_of(script_, op);
    if (frame_.boxes.size() > n) frame_.boxes.resize(n);
    for (unsigned k = 0; frame_.boxes.size() < n; ++k) add(op, k);
    resize_filters();
  }

  void apply_to(std::size_t k, const CoreOp& op, unsigned call) {
    if (op.verb == CoreVerb::filter) {
      if (!frame_.filters.empty()) frame_.filters[k] = filter_of(script_, op, call);
    } else if (op.verb == CoreVerb::remove && op.which % 2 == 0 &&
               frame_.boxes.size() > frame_.first_count.value_or(0)) {
      frame_.boxes.pop_back();
      resize_filters();
    } else {
      frame_.boxes[k] = op.verb == CoreVerb::remove ? inverted : box_of(script_, op, call);
    }
  }

  /// @param lists 0: they are one too short, so that this update and all later ones are incomplete. 1: they
  /// just suffice. Otherwise they are long.
  void enqueue(unsigned lists) {
    const std::size_t longest = twins_.changes_of(frame_);
    const std::size_t capacity = lists == 0 && longest > 0 ? longest - 1
                                 : lists == 1              ? longest
                                                           : longest + 1000;
    twins_.enqueue(frame_, std::max<std::size_t>(1, capacity));
  }

  void refuse() {
    DeviceBroadPhase& broad_phase = twins_.tested();
    const bool is_begun = twins_.is_in_flight();
    const Pairs of_itself{{0, 1}, {3, 3}};
    require_error(is_begun ? "finish()" : "and itself", [&] { broad_phase.set_exclusions(of_itself); });
    if (is_begun) {
      require_error("finish()", [&] { (void)broad_phase.pairs(); });
      require_error("finish()", [&] { broad_phase.reserve(1, 1); });
      require_error("finish()", [&] { broad_phase.begin(twins_.arguments()); });
    } else {
      require_error("without begin()", [&] { (void)broad_phase.finish(); });
      require_error("is null", [&] { broad_phase.begin({.buffer = nullptr, .count = 3}); });
    }
  }

  const CoreScript& script_;
  DeviceTwins<> twins_;
  DeviceFrame frame_;
};

class RandomDevice : public ::testing::TestWithParam<std::string> {
 protected:
  void play(ScriptSize size, std::size_t scripts, std::optional<std::uint64_t> seed) const {
    check_scripts(GetParam(), scripts, seed, [&] {
      const CoreScript script = *core_scripts(size);
      DevicePlayer player(queue_, GetParam(), script);
      apply_each(script.ops, [&](const CoreOp& op) { player.apply(op); });
      player.update();
    });
  }

  CallersQueue queue_;
};

SUITE_ALSO_IN(RandomDevice, gpu_profile | rusticl);

TEST_P(RandomDevice, SomeRandomCalls) {
  play(ScriptSize::small, is_slow_device() ? 3 : 10, seed_of_ci);
}

ALSO_IN(oclgrind);
TEST_P(RandomDevice, SmallRandomCalls) {
  play(ScriptSize::tiny, 3, seed_of_ci);
}

INSTANTIATE_TEST_SUITE_P(All, RandomDevice, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

using LongRandomDevice = RandomDevice;

TEST_P(LongRandomDevice, ManyRandomCalls) {
  play(ScriptSize::small, 2000, std::nullopt);
}

INSTANTIATE_TEST_SUITE_P(Long, LongRandomDevice, ::testing::Values("auto", "brute-force", "tiles"),
                         named_by_parameter);

}  // namespace
}  // namespace broadcl::test
