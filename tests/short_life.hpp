#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <span>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "reference.hpp"
#include "trouble.hpp"

namespace broadcl::test {

/// Calls every function of a BroadPhase over a few frames. Each call is repeated if it fails, and all answers
/// must be those of the reference.
/// @tparam Subject BroadPhase, or the Core of one.
template <class Trouble, class Subject = BroadPhase>
class ShortLife {
 public:
  /// @param argument For the subject's constructor.
  template <class Argument>
  ShortLife(Argument&& argument, Trouble trouble, Habits habits)
      : broad_phase_(std::forward<Argument>(argument)), trouble_(trouble), habits_(habits) {}

  /// @returns Whether every answer was right; it stops at the first wrong one.
  bool live() {
    try {
      live_on();
    } catch (const std::exception& error) {
      expect(::testing::AssertionFailure() << "a call fails by itself: " << error.what());
    }
    return is_right_;
  }

  [[nodiscard]] const Trouble& trouble() const { return trouble_; }
  [[nodiscard]] const Subject& subject() const { return broad_phase_; }

 private:
  void live_on() {
    for (std::uint32_t k = 0; k < 10; ++k) add(at(k), {.group = 1U + k % 2, .mask = k % 5 == 0 ? 1U : 3U});
    update();
    for (int k = 0; k < habits_.updates; ++k) {
      move(3, at(k % 2 == 0 ? 5 : 3));
      update();
    }
    move(3, at(7));
    set_filter(4, {.mask = 0});
    remove(2);
    add(at(1));
    remove(9);
    begin();
    move(1, at(4));
    remove(5);
    add(at(6), {.body = 1});
    for (std::uint32_t k = 0; k < 30; ++k) add(at(k), {.body = k % 4});
    set_filter(0, {.world = habits_.worlds ? 1U : 0U});
    finish();
    update();
    map(20, 1);
    map(200, 0.001F);  // all pair
    begin();
    move(5, at(500));
    finish();
    update();
    shrink();
    map(12, 0.5F);
    remove(11);
    shrink();
    finish();
    add(at(2));
    move(0, at(1));
    update();
  }

  static Aabb at(std::size_t k, float distance = 0.7F) {
    const float x = static_cast<float>(k) * distance;
    return {{x, 0, 0}, {x + 1, 1, 1}};
  }

  void expect(const ::testing::AssertionResult& result) {
    EXPECT_TRUE(result);
    is_right_ = is_right_ && result;
  }

  /// Nothing that a caller can see may have changed.
  void look() {
    expect(equal("size", broad_phase_.size(), reference_.size()));
    if (habits_.looks && !reference_.is_in_flight())
      expect(same("known", broad_phase_.pairs(), reference_.pairs()));
  }

  template <class Function>
  auto call(const Function& function) {
    return trouble_.call(function, [this] { look(); });
  }

  void add(const Aabb& box, const Filter& filter = {}) {
    if (!is_right_) return;
    const std::uint32_t id = call([&] { return broad_phase_.add(box, filter); });
    expect(equal("id", id, reference_.add(box, filter)));
  }
  void move(std::uint32_t id, const Aabb& box) {
    if (!is_right_) return;
    call([&] { broad_phase_.move(id, box); });
    reference_.move(id, box);
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    if (!is_right_) return;
    call([&] { broad_phase_.set_filter(id, filter); });
    reference_.set_filter(id, filter);
  }
  void remove(std::uint32_t id) {
    if (!is_right_) return;
    call([&] { broad_phase_.remove(id); });
    reference_.remove(id);
  }
  /// Writes all boxes directly to the memory that the device reads, and updates.
  void map(std::size_t n, float distance) {
    if (!is_right_) return;
    const std::span<Aabb> boxes = call([&] { return broad_phase_.map(n); });
    reference_.map(n);
    for (std::uint32_t id = 0; id < n; ++id) {
      boxes[id] = at(id, distance);
      reference_.move(id, boxes[id]);
    }
    update();
  }
  void shrink() {
    if (is_right_) call([&] { broad_phase_.shrink(); });
  }
  void begin() {
    if (!is_right_) return;
    call([&] { broad_phase_.begin(); });
    reference_.begin();
  }
  void update() {
    expect_changes([this] {
      if constexpr (requires { broad_phase_.update(); }) return broad_phase_.update();
      return broad_phase_.finish();
    });
  }
  void finish() {
    expect_changes([this] { return broad_phase_.finish(); });
  }

  template <class Function>
  void expect_changes(const Function& function) {
    if (!is_right_) return;
    const Delta delta = trouble_.call(function, [this] {
      reference_.abandon();  // an update that was begun is over
      look();
    });
    const Reference::Changes changes = reference_.finish();
    expect(same(delta, changes.added, changes.removed));
    expect(equal("size", broad_phase_.size(), reference_.size()));
    if (is_right_) expect(same("all", call([&] { return broad_phase_.pairs(); }), reference_.pairs()));
  }

  static ::testing::AssertionResult equal(const char* what, std::size_t is, std::size_t expected) {
    if (is == expected) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure() << what << " is " << is << ", expected " << expected;
  }

  Subject broad_phase_;
  Reference reference_;
  Trouble trouble_;
  Habits habits_;
  bool is_right_ = true;
};

}  // namespace broadcl::test
