#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/error.hpp>

#include "base/box_replacement.hpp"
#include "base/distance.hpp"
#include "boxes.hpp"
#include "device_limits.hpp"
#include "each_algorithm.hpp"
#include "engines/algorithm.hpp"
#include "engines/engine.hpp"
#include "environment.hpp"
#include "failing_opencl.hpp"
#include "finder_variants.hpp"
#include "random_scripts.hpp"
#include "runs.hpp"
#include "test_name.hpp"

/// Objects that reach beyond their boxes, on devices.
namespace broadcl::test {
namespace {

struct Object {
  Aabb box{};
  float reach = 0;
  Filter filter{};
};

enum class Filters { none, groups, worlds, sets, sets_of_worlds };

/// Boxes that arrive in three pieces.
class InPieces final : public ArrivingBoxes {
 public:
  InPieces(std::span<const Aabb> from, std::span<Aabb> to) : from_(from), to_(to) {}
  std::size_t next() override {
    const std::size_t begin = end_;
    end_ = std::min(from_.size(), end_ + from_.size() / 3 + 1);
    std::ranges::copy(from_.subspan(begin, end_ - begin), to_.subspan(begin).begin());
    return end_;
  }
  void stop() noexcept override {}

 private:
  std::span<const Aabb> from_;
  std::span<Aabb> to_;
  std::size_t end_ = 0;
};

/// Gives an algorithm random objects, whose bounds and reaches are small integers times a scale, and compares
/// its changes with tests of all pairs.
class ReachPlayer {
 public:
  ReachPlayer(AlgorithmPointer algorithm, unsigned seed, float scale, float origin, Filters filters)
      : algorithm_(std::move(algorithm)), dice_(seed), scale_(scale), origin_(origin), filters_(filters) {}

  /// Changes a share of the objects: one in so many.
  void change(unsigned one_in, unsigned slots) {
    const std::size_t before = objects_.size();
    objects_.resize(slots);
    for (std::vector<char>* marks : {&changed_, &recycled_, &refiltered_}) marks->resize(slots);
    for (std::size_t slot = 0; slot < slots; ++slot) {
      const bool is_new = slot >= before;
      if (!is_new && !dice_.one_in(one_in)) continue;
      Object& object = objects_[slot];
      changed_[slot] = 1;
      if (is_new || dice_.one_in(10)) recycled_[slot] = 1;
      if (recycled_[slot] != 0 || !dice_.one_in(3)) object.box = random_box();
      if (recycled_[slot] != 0 || dice_.one_in(3)) object.reach = random_reach();
      if (recycled_[slot] == 0 && !dice_.one_in(5)) continue;
      object.filter = random_filter();
      refiltered_[slot] = 1;
    }
  }
  /// Replaces all objects by points, so that the distance of each from its neighbour is about their reach.
  void set_points(unsigned count) {
    objects_.assign(count, {});
    for (std::vector<char>* marks : {&changed_, &recycled_, &refiltered_}) marks->assign(count, char{1});
    const auto number = [this] { return origin_ + scale_ * static_cast<float>(dice_.below(1U << 24)); };
    for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
      Object& object = objects_[slot];
      for (std::size_t axis = 0; axis < 3; ++axis) object.box.lower[axis] = number();
      object.box.upper = object.box.lower;
      const Aabb& last = objects_[slot - slot % 2].box;
      object.reach = slot % 2 == 0 ? 0 : std::sqrt(squared_distance(object.box, last));
    }
  }
  /// All boxes move, and nothing else changes.
  void drift() {
    for (Object& object : objects_) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float step = scale_ / 4 * static_cast<float>(dice_.below(3));
        object.box.lower[axis] += step;
        object.box.upper[axis] += step;
      }
    }
    std::ranges::fill(changed_, char{1});
  }
  void change_reaches(unsigned one_in) {
    for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
      if (!dice_.one_in(one_in)) continue;
      objects_[slot].reach = random_reach();
      changed_[slot] = 1;
    }
  }
  void drop_reaches() {
    for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
      changed_[slot] |= static_cast<char>(objects_[slot].reach > 0);
      objects_[slot].reach = 0;
    }
  }
  void exclude() {
    const auto mark = [this] {
      for (const Pair& pair : exclusions_) {
        for (const std::uint32_t slot : {pair.a, pair.b}) {
          if (slot < changed_.size()) changed_[slot] = 1;
        }
      }
    };
    mark();
    exclusions_.clear();
    for (const Pair& pair : pairs_) {
      if (dice_.one_in(5)) exclusions_.push_back(pair);
    }
    mark();
    are_exclusions_new_ = true;
  }
  void shrink() {
    algorithm_->reserve(objects_.size(), filters_ != Filters::none);
    algorithm_->shrink(objects_.size());
  }

  /// @param arriving Whether boxes arrive meanwhile, if all count as changed.
  /// @returns Whether it did not fail.
  bool update(bool arriving = false) {
    algorithm_->reserve(objects_.size(), filters_ != Filters::none);
    algorithm_->reserve_exclusions(exclusions_.size());
    std::vector<float> reaches;
    std::vector<Filter> filters;
    std::vector<Aabb> boxes;
    for (const Object& object : objects_) {
      reaches.push_back(object.reach);
      filters.push_back(object.filter);
      boxes.push_back(pack(object.box));
    }
    if (std::ranges::all_of(reaches, [](float reach) { return reach == 0; })) reaches.clear();
    if (filters_ == Filters::none) filters.clear();
    const std::vector<std::uint32_t> changed = marked(changed_);
    const std::vector<std::uint32_t> recycled = marked(recycled_);
    std::vector<std::uint32_t> refiltered =
        filters.empty() ? std::vector<std::uint32_t>() : marked(refiltered_);
    const bool all = has_failed_ || changed.size() > objects_.size() / 4;
    Input input{.boxes = algorithm_->boxes().first(objects_.size()),
                .changed = {.all = all, .recycled = recycled},
                .rules = {.filters = filters,
                          .exclusions = exclusions_,
                          .reaches = reaches,
                          .all_changed = has_failed_,
                          .refiltered = refiltered,
                          .exclusions_changed = are_exclusions_new_,
                          .worlds = filters_ == Filters::worlds || filters_ == Filters::sets_of_worlds,
                          .sets = filters_ >= Filters::sets}};
    if (!all) input.changed.slots = changed;
    input.rules.filters_changed =
        std::ranges::any_of(refiltered, [&](std::uint32_t slot) { return recycled_[slot] == 0; });
    InPieces pieces(boxes, algorithm_->boxes());
    if (arriving && all && algorithm_->uploads_boxes()) {
      input.arriving = &pieces;
    } else {
      std::ranges::copy(boxes, algorithm_->boxes().begin());
    }
    try {
      algorithm_->begin(input);
      check(algorithm_->finish());
    } catch (const Error&) {
      has_failed_ = true;
      return false;
    }
    has_failed_ = are_exclusions_new_ = false;
    for (std::vector<char>* marks : {&changed_, &recycled_, &refiltered_}) std::ranges::fill(*marks, char{0});
    return true;
  }

  void expect_all_pairs() {
    EXPECT_TRUE(same("pairs", algorithm_->pairs(), pairs_));
    const Touching touching = algorithm_->touching(7);
    EXPECT_TRUE(touching.all);
    for (const Pair& pair : pairs_) {
      const bool touches = packed_touch(objects_[pair.a].box, objects_[pair.b].box, 7);
      EXPECT_TRUE(!touches || std::ranges::find(touching.pairs, pair) != touching.pairs.end());
    }
  }
  [[nodiscard]] std::size_t pairs() const { return pairs_.size(); }
  [[nodiscard]] Dice& dice() { return dice_; }

 private:
  Aabb random_box() {
    if (dice_.one_in(20)) return {{1, 0, 0}, {0, 0, 0}};
    Aabb box;
    const unsigned most_size = dice_.one_in(2) ? 1 : 4;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const unsigned lower = dice_.below(14);
      box.lower[axis] = origin_ + scale_ * static_cast<float>(lower);
      box.upper[axis] = origin_ + scale_ * static_cast<float>(lower + dice_.below(most_size));
    }
    if (dice_.one_in(40)) box.lower[dice_.below(3)] = -infinity;
    if (dice_.one_in(40)) box.upper[dice_.below(3)] = infinity;
    if (dice_.one_in(80)) box.lower[2] = box.upper[2] = infinity;
    return box;
  }
  float random_reach() {
    constexpr std::array<float, 8> reaches{0, 0, 0.25F, 0.5F, 0.5F, 1, 1.5F, 2.5F};
    return std::min(most_reach<float>, scale_ * dice_.pick(reaches));
  }
  Filter random_filter() {
    Filter filter;
    if (filters_ == Filters::groups) filter = {.group = 1U << dice_.below(3), .mask = dice_.below(8)};
    if (filters_ >= Filters::sets) filter = dice_.one_in(2) ? Filter::first_set : Filter::second_set;
    if (filters_ == Filters::worlds || filters_ == Filters::sets_of_worlds) {
      filter.world = dice_.one_in(10) ? Filter::all_worlds : dice_.below(3);
    }
    return filter;
  }

  static std::vector<std::uint32_t> marked(const std::vector<char>& marks) {
    std::vector<std::uint32_t> slots;
    for (std::size_t slot = 0; slot < marks.size(); ++slot) {
      if (marks[slot] != 0) slots.push_back(static_cast<std::uint32_t>(slot));
    }
    return slots;
  }

  void check(const Delta& delta) {
    Pairs now;
    Pairs added;
    Pairs removed;
    const auto before = [](const Pair& s, const Pair& t) { return s.b != t.b ? s.b < t.b : s.a < t.a; };
    const auto is_other = [&](const Pair& pair) {
      return pair.b >= recycled_.size() || recycled_[pair.a] != 0 || recycled_[pair.b] != 0;
    };
    for (const Pair& pair : all_pairs(static_cast<std::uint32_t>(objects_.size()))) {
      const Object& s = objects_[pair.a];
      const Object& t = objects_[pair.b];
      if (!is_within(pack(s.box), pack(t.box), s.reach + t.reach)) continue;
      if (filters_ != Filters::none && !may_pair(s.filter, t.filter)) continue;
      if (std::ranges::binary_search(exclusions_, pair, before)) continue;
      now.push_back(pair);
      if (is_other(pair) || !std::ranges::binary_search(pairs_, pair, before)) added.push_back(pair);
    }
    for (const Pair& pair : pairs_) {
      if (is_other(pair) || !std::ranges::binary_search(now, pair, before)) removed.push_back(pair);
    }
    EXPECT_TRUE(same(delta, added, removed));
    pairs_ = std::move(now);
  }

  AlgorithmPointer algorithm_;
  Dice dice_;
  float scale_, origin_;
  Filters filters_;
  std::vector<Object> objects_;
  std::vector<char> changed_, recycled_, refiltered_;  // slots, since the last update
  Pairs exclusions_;
  bool are_exclusions_new_ = false;
  bool has_failed_ = false;
  Pairs pairs_;  // of the last update
};

/// An algorithm on a device.
struct Subject {
  std::string name;
  MakePairFinder make = nullptr;  ///< If null, the name is in the table.

  [[nodiscard]] AlgorithmPointer algorithm() const {
    return make != nullptr ? make_device_algorithm({}, make) : make_algorithm({.algorithm = name});
  }
  friend std::ostream& operator<<(std::ostream& out, const Subject& subject) { return out << subject.name; }
};

std::vector<Subject> subjects() {
  std::vector<Subject> all{{"gpu-bf"}, {"brute-force"}, {"tiles"}, {"auto", find_pair_finder("auto")}};
  for (const FinderVariant& variant : finder_variants) all.push_back({variant.name, variant.make});
  return all;
}

class ReachOnDevice : public ::testing::TestWithParam<Subject> {};
SUITE_ALSO_IN(ReachOnDevice, gpu_profile | rusticl);
INSTANTIATE_TEST_SUITE_P(Table, ReachOnDevice, ::testing::ValuesIn(subjects()), named_by_parameter);

/// At the limit exactly; with thirds, near it; far from the origin, where little is left of a reach; around
/// the least distance; denormal; and where squares overflow.
struct Numbers {
  float scale, origin;
};
constexpr std::array numbers{
    Numbers{1, 0},        Numbers{1.0F / 3, -2}, Numbers{1.0F / 3, 1e6F},   Numbers{0x1p-63F, 0},
    Numbers{0x1p-65F, 0}, Numbers{0x1p-148F, 0}, Numbers{0x1p61F, 0x1p64F}, Numbers{1e37F, -1e38F}};

void play(const Subject& subject, unsigned seed, const Numbers& of, Filters filters) {
  SCOPED_TRACE(testing::Message() << "seed " << seed << ", scale " << of.scale);
  ReachPlayer player(subject.algorithm(), seed, of.scale, of.origin, filters);
  std::size_t most = 0;
  for (unsigned frame = 0; frame < 24; ++frame) {
    SCOPED_TRACE(testing::Message() << "frame " << frame);
    Dice& dice = player.dice();
    const unsigned slots = frame == 20 ? 400 : 100 + dice.below(60);
    if (dice.one_in(4)) {
      player.drift();
    } else if (!dice.one_in(20)) {
      player.change(dice.one_in(3) ? 2 : 20, slots);
    }
    if (frame == 2 || dice.one_in(25)) player.drop_reaches();
    if (dice.one_in(6)) player.exclude();
    if (dice.one_in(8)) player.shrink();
    ASSERT_TRUE(player.update(dice.one_in(2)));
    most = std::max(most, player.pairs());
    player.expect_all_pairs();
    if (testing::Test::HasFailure()) return;
  }
  EXPECT_GT(most, 20U);
}

TEST_P(ReachOnDevice, FindsTheChangesOfWhatIsWithinReach) {
  unsigned seed = 0;
  for (const Numbers& of : numbers) {
    for (const Filters filters :
         {Filters::none, Filters::groups, Filters::worlds, Filters::sets, Filters::sets_of_worlds}) {
      play(GetParam(), ++seed, of, filters);
    }
  }
}

TEST_P(ReachOnDevice, RoundsDistancesAsTheHostDoes) {
  for (const Numbers& of : {Numbers{1.0F / 3, 0}, Numbers{0x1p-20F / 3, 1000}, Numbers{0x1p-80F, 0}}) {
    ReachPlayer player(GetParam().algorithm(), 1, of.scale, of.origin, Filters::none);
    player.set_points(600);
    ASSERT_TRUE(player.update());
    player.expect_all_pairs();
  }
}

/// Reaches that grow move the sides of grown boxes, as far as boxes move in other frames, or farther.
TEST(ReachOnDevice, FindsItAlsoIfTheSearchIsEarly) {
  ReachPlayer player(
      make_device_algorithm({}, [](const opencl::Context& context) { return make_tiles(context, 3, 1); }), 1,
      1, 0, Filters::groups);
  player.change(1, 200);
  const long early = launches_of("near_pairs_grow");
  for (unsigned frame = 0; frame < 60; ++frame) {
    SCOPED_TRACE(testing::Message() << "frame " << frame);
    ASSERT_TRUE(player.update(frame % 2 == 0));
    player.drift();
    if (frame % 7 == 0) player.change_reaches(frame % 2 == 0 ? 2 : 40);
  }
  player.expect_all_pairs();
  EXPECT_GT(launches_of("near_pairs_grow"), early + 10);
}

NOT_IN(gpu_profile | rusticl, "compiles all kernels anew");
TEST_P(ReachOnDevice, IsTheSameIfTheDeviceFlushesDenormalNumbers) {
  const LimitedDevices limited({.has_denormals = false});
  const ScopedVariable cache("BROADCL_CACHE_DIR", "/dev/null");
  for (const Numbers& of : numbers) play(GetParam(), 1, of, Filters::none);
}

NOT_IN(gpu_profile | rusticl | sanitizers,
       "fails on purpose, also where buffers are unmapped, and takes long");
TEST_P(ReachOnDevice, ADeviceThatFailsLosesNothing) {
  ReachPlayer player(GetParam().algorithm(), 1, 1, 0, Filters::groups);
  player.change(1, 100);
  ASSERT_TRUE(player.update());
  unsigned failures = 0;
  for (unsigned frame = 0; frame < 200; ++frame) {
    SCOPED_TRACE(testing::Message() << "frame " << frame);
    player.change(frame % 2 == 0 ? 30 : 2, 100);
    const FailingOpenCl fails(player.dice().below(60), 1);
    failures += player.update(frame % 4 == 1) ? 0U : 1U;
  }
  EXPECT_GT(failures, 20U);
  ASSERT_TRUE(player.update());
  player.expect_all_pairs();
}

ALSO_IN(gpu_profile | rusticl | oclgrind);
TEST_P(ReachOnDevice, ReachesAreUploadedIfTheyChange) {
  const auto transfers = [](ReachPlayer& player) {
    const long before = opencl_use().transfers;
    EXPECT_TRUE(player.update());
    return opencl_use().transfers - before;
  };
  ReachPlayer player(GetParam().algorithm(), 1, 1, 0, Filters::none);
  player.change(1, 100);
  const long with_reaches = transfers(player);
  EXPECT_GT(launches_of("grow_boxes"), 0);
  player.drift();
  player.drift();
  const long same_reaches = transfers(player);
  EXPECT_LT(same_reaches, with_reaches);
  player.drop_reaches();
  player.drift();
  EXPECT_EQ(transfers(player), same_reaches);
  const long grown = launches_of("grow_boxes");
  player.drift();
  EXPECT_EQ(transfers(player), same_reaches);
  EXPECT_EQ(launches_of("grow_boxes"), grown);
}

}  // namespace
}  // namespace broadcl::test
