// Random calls to Bullet's broad phase interface: whatever the calls and their order, each algorithm's cache
// holds the pairs that follow from the definitions, in the order of the oracle, and overlaps are those of
// Bullet's own broad phases. How to repeat a failed run: docs/testing.md.
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletCollision/BroadphaseCollision/btSimpleBroadphase.h>
#include <BulletCollision/CollisionDispatch/btCollisionDispatcher.h>
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "bullet_random_reference.hpp"
#include "bullet_random_script.hpp"
#include "bullet_random_stock.hpp"
#include "bullet_random_subject.hpp"
#include "each_algorithm.hpp"
#include "test_name.hpp"

namespace broadcl {
namespace {

using test::BulletReference;
using test::CacheKind;
using test::Corners;
using test::EachAlgorithm;
using test::gates;
using test::Op;
using test::Script;
using test::Stock;
using test::Subject;
using test::Verb;

/// Plays one script to the broad phase under test, the oracle, Bullet's own and the reference.
class Player {
 public:
  Player(const std::string& algorithm, CacheKind cache, btDispatcher& dispatcher)
      : cache_(cache),
        reference_(cache),
        subject_(algorithm, cache, dispatcher),
        oracle_("oracle", cache, dispatcher),
        simple_(simple_broadphase_, dispatcher),
        tree_(tree_broadphase_, dispatcher) {}

  /// @returns Whether there was something to do.
  bool apply(const Op& op);
  void end() {
    clear();
    check();
    for_subjects([](Subject& subject) { subject.check_end(); });
  }

 private:
  template <class Function>
  void for_subjects(const Function& function) {
    function(subject_);
    function(oracle_);
  }

  bool apply_to_proxies(const Op& op);
  bool apply_to_pairs(const Op& op);
  void create(const Corners& box, int group, int mask);
  void destroy(int id);
  void move(int id, const Corners& box);
  void set_callback(unsigned which);
  void query(const Op& op);
  void step();
  void clear() {
    for (const int id : reference_.live()) destroy(id);
  }
  void check() {
    const test::CacheChanges changes = reference_.take_changes();
    for_subjects([&](Subject& subject) { subject.check(reference_, changes); });
  }

  CacheKind cache_;
  // Changes to the cache since the last step that bypassed the broad phase. It notices them by the number of
  // pairs, so a script either adds or removes pairs in a step.
  bool pairs_were_added_ = false;
  bool pairs_were_removed_ = false;
  BulletReference reference_;
  Subject subject_;
  Subject oracle_;
  btSimpleBroadphase simple_broadphase_{test::most_proxies};
  btDbvtBroadphase tree_broadphase_;
  Stock simple_;
  Stock tree_;
};

void Player::create(const Corners& box, int group, int mask) {
  const int id = reference_.create(box, group, mask);
  for_subjects([&](Subject& subject) { subject.create(id, box, group, mask); });
  simple_.create(id, box);
  tree_.create(id, test::for_tree(box));
}

void Player::destroy(int id) {
  reference_.destroy(id);
  for_subjects([&](Subject& subject) { subject.destroy(id); });
  simple_.destroy(id);
  tree_.destroy(id);
}

void Player::move(int id, const Corners& box) {
  reference_.move(id, box);
  for_subjects([&](Subject& subject) { subject.move(id, box); });
  simple_.move(id, box);
  tree_.move(id, test::for_tree(box));
}

void Player::set_callback(unsigned which) {
  const std::size_t place = which % (2 * gates.size());  // none, half of the time
  btOverlapFilterCallback* callback = place < gates.size() ? &gates[place] : nullptr;
  reference_.set_callback(callback);
  for_subjects([&](Subject& subject) { subject.set_callback(callback); });
}

void Player::query(const Op& op) {
  for (unsigned k = 0; k < op.count; ++k) {
    const Corners box = test::corners(test::box_of_call(op.box, k));
    if (op.verb == Verb::box_queries) {
      if (test::is_invalid(box)) continue;
      for_subjects([&](Subject& subject) { subject.check_box_query(reference_, box); });
      continue;
    }
    Corners ray{.lower = test::corners({.corner = test::box_of_call(op.box, k).corner}).lower, .upper = {}};
    ray.upper = ray.lower;
    for (int axis = 0; axis < 3; ++axis) {
      const auto bit = 1U << static_cast<unsigned>(axis);
      const btScalar length = 3 * btScalar(op.box.size[static_cast<std::size_t>(axis)]);
      ray.upper[axis] += (op.which & bit) != 0 ? -length : length;
    }
    const bool is_swept = op.which % 3 == 0;
    const btVector3 half(btScalar(0.5), btScalar(0.5), btScalar(0.5));
    const Corners sweep = is_swept ? Corners{-half, half} : Corners{{0, 0, 0}, {0, 0, 0}};
    for_subjects([&](Subject& subject) { subject.check_ray(reference_, ray, sweep); });
  }
}

void Player::step() {
  pairs_were_added_ = pairs_were_removed_ = false;
  reference_.calculate();
  for_subjects([](Subject& subject) { subject.calculate(); });
  check();
  for_subjects([&](Subject& subject) {
    subject.check_pairs(reference_);
    subject.check_bounds(reference_);
    if (cache_ == CacheKind::null) subject.check_known(reference_);
  });
  if (subject_.pairs() != oracle_.pairs()) test::fail("the order of pairs is not that of the oracle");
  // Bullet's simple broad phase tests all pairs as well, but treats inverted boxes as valid.
  std::vector<Pair> exact = simple_.calculate();
  std::erase_if(exact, [&](const Pair& pair) {
    return test::is_invalid(reference_.box(static_cast<int>(pair.a))) ||
           test::is_invalid(reference_.box(static_cast<int>(pair.b)));
  });
  if (exact != reference_.overlapping()) test::fail("btSimpleBroadphase has other overlaps");
  // Bullet's tree keeps pairs for longer than they overlap.
  const std::vector<Pair> lazy = tree_.calculate();
  if (!std::includes(lazy.begin(), lazy.end(), reference_.overlapping().begin(),
                     reference_.overlapping().end())) {
    test::fail("btDbvtBroadphase lacks an overlap");
  }
}

bool Player::apply_to_proxies(const Op& op) {
  const std::vector<int> live = reference_.live();
  if (live.empty()) return false;
  const auto id_of_call = [&](unsigned k) { return live[(op.which + k) % live.size()]; };
  const int id = id_of_call(0);
  switch (op.verb) {
    case Verb::destroy:
      destroy(id);
      break;
    case Verb::recreate: {
      const Corners box = reference_.box(id);
      destroy(id);
      create(box, op.group, op.mask);
      break;
    }
    case Verb::move:
      for (unsigned k = 0; k < op.count; ++k)
        move(id_of_call(k), test::corners(test::box_of_call(op.box, k)));
      break;
    case Verb::set_again: {
      const Corners box = reference_.box(id);
      move(id, box);
      break;
    }
    case Verb::filter:
      for (unsigned k = 0; k < op.count; ++k) {
        const int written = id_of_call(k);
        reference_.write_filter(written, op.group, op.mask);
        for_subjects([&](Subject& subject) { subject.write_filter(written, op.group, op.mask); });
      }
      break;
    case Verb::remove_pairs_of:
      if (pairs_were_added_) return false;
      pairs_were_removed_ = true;
      reference_.remove_pairs_of(id);
      for_subjects([&](Subject& subject) { subject.remove_pairs_of(id); });
      break;
    case Verb::clean_pairs_of:
      for_subjects([&](Subject& subject) { subject.clean_pairs_of(id); });
      break;
    case Verb::clear:
      clear();
      for_subjects([](Subject& subject) { subject.reset(); });
      break;
    default:
      test::fail("this verb is not one of proxies");
  }
  return true;
}

bool Player::apply_to_pairs(const Op& op) {
  if (reference_.cached().empty()) return false;
  const auto place = static_cast<std::ptrdiff_t>(op.which % reference_.cached().size());
  const Pair pair = *std::next(reference_.cached().begin(), place);
  if (op.verb == Verb::add_again) {
    if (pairs_were_removed_) return false;
    pairs_were_added_ = true;
    // A sorted cache treats it as a new one.
    if (cache_ == CacheKind::sorted && reference_.may_enter(pair)) reference_.add_again(pair);
    for_subjects([&](Subject& subject) { subject.add_again(pair); });
    return true;
  }
  if (pairs_were_added_) return false;
  pairs_were_removed_ = true;
  // A sorted cache removes nothing when it is asked to.
  if (cache_ != CacheKind::sorted) reference_.remove_pair(pair);
  for_subjects([&](Subject& subject) { subject.remove_pair(pair); });
  return true;
}

bool Player::apply(const Op& op) {
  bool is_done = true;
  switch (op.verb) {
    case Verb::create:
      for (unsigned k = 0; k < op.count && reference_.live().size() < test::most_proxies; ++k) {
        create(test::corners(test::box_of_call(op.box, k)), op.group, op.mask);
      }
      break;
    case Verb::callback:
      set_callback(op.which);
      break;
    case Verb::remove_pair:
    case Verb::add_again:
      is_done = apply_to_pairs(op);
      break;
    case Verb::begin:
      reference_.begin();
      for_subjects([](Subject& subject) { subject.begin(); });
      break;
    case Verb::step:
      step();
      break;
    case Verb::rays:
    case Verb::box_queries:
      query(op);
      break;
    case Verb::reset:
      for_subjects([](Subject& subject) { subject.reset(); });
      break;
    default:
      is_done = apply_to_proxies(op);
  }
  check();
  return is_done;
}

constexpr std::size_t script_length = 400;

/// Plays scripts until this many operations are done, and fails the test with the shortest script that goes
/// wrong.
/// @param seed As for check_scripts().
void play(const std::string& algorithm, std::size_t operations, std::optional<std::uint64_t> seed) {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  std::size_t done = 0;
  // Some operations have nothing to do, because no proxy exists or no pair is cached.
  const std::size_t scripts = operations / script_length * 21 / 20 + 1;
  test::check_scripts(algorithm, scripts, seed, [&] {
    const Script script = *test::scripts(script_length);
    Player player(algorithm, script.cache, dispatcher);
    test::apply_each(script.ops, [&](const Op& op) {
      if (player.apply(op)) ++done;
    });
    player.end();
  });
  testing::Test::RecordProperty("operations", std::to_string(done));
  if (!testing::Test::HasFailure() && !test::is_reproduced()) {
    EXPECT_GE(done, operations);
  }
}

// Only a few, because they run with every tuning, device and sanitizer.
TEST_P(EachAlgorithm, SomeRandomCallsByBullet) {
  play(std::string(GetParam().name), is_slow() ? 400 : 2000, test::seed_of_ci);
}

// The algorithms share the operations equally.
class RandomCalls : public testing::TestWithParam<AlgorithmInfo> {};

INSTANTIATE_TEST_SUITE_P(Table, RandomCalls, testing::ValuesIn(test::device_algorithms()),
                         test::named_by_parameter);

NOT_IN(all_default | sanitizers, "takes long; SomeRandomCallsByBullet is in it");
TEST_P(RandomCalls, AHundredThousandByBullet) {
  const std::size_t n = test::device_algorithms().size();
  play(std::string(GetParam().name), (100'000 + n - 1) / n, test::seed_of_ci);
}

TEST(Long, MillionsOfRandomCallsByBullet) {
  for (const AlgorithmInfo& info : test::device_algorithms())
    play(std::string(info.name), 1'000'000, std::nullopt);
}

}  // namespace
}  // namespace broadcl
