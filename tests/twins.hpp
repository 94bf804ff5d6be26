#pragma once

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>

#include "each_algorithm.hpp"
#include "reference.hpp"
#include "warped.hpp"

namespace broadcl::test {

/// Lets every call succeed; Trouble makes some fail.
struct NoTrouble {
  template <class Function, class AfterFailure>
  auto call(const Function& function, const AfterFailure& /*after_failure*/) {
    return function();
  }
};

/// A subject and the reference, which get the same calls.
/// @tparam Subject BroadPhase, the Core of one, or a class with the same functions.
/// @tparam Trouble Makes calls of the subject fail, and repeats them.
template <class Subject = BroadPhase, class Trouble = NoTrouble>
class Twins {
 public:
  explicit Twins(const BroadPhase::Config& config) : subject_(config) {}
  /// @param looks Whether all pairs are compared after each failure, which might repair what it broke.
  /// @param arguments For the subject's constructor.
  template <class... Arguments>
  Twins(std::in_place_t /*tag*/, const Trouble& trouble, bool looks, Arguments&&... arguments)
      : subject_(std::forward<Arguments>(arguments)...), trouble_(trouble), looks_(looks) {}

  std::uint32_t add(const Aabb& box, const Filter& filter = {}) {
    const std::uint32_t id = call([&] { return subject_.add(box, filter); });
    expect_equal("a new id", id, reference_.add(box, filter));
    return id;
  }
  void move(std::uint32_t id, const Aabb& box) {
    call([&] { subject_.move(id, box); });
    reference_.move(id, box);
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    call([&] { subject_.set_filter(id, filter); });
    reference_.set_filter(id, filter);
  }
  /// @param filters As many as ids, or one for all.
  void set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters) {
    const auto filter = [&](std::size_t k) { return filters[filters.size() == 1 ? 0 : k]; };
    if constexpr (requires { subject_.set_filters(ids, filters); }) {
      call([&] { subject_.set_filters(ids, filters); });
    } else {
      for (std::size_t k = 0; k < ids.size(); ++k) call([&] { subject_.set_filter(ids[k], filter(k)); });
    }
    for (std::size_t k = 0; k < ids.size(); ++k) reference_.set_filter(ids[k], filter(k));
  }
  /// Whether the subject has reaches.
  [[nodiscard]] bool has_reaches() const {
    return requires {
      subject_.set_reach(std::span<const std::uint32_t>(), std::span<const float>());
    };
  }
  /// @param reaches As many as ids, or one for all. Only if it has reaches.
  void set_reach(std::span<const std::uint32_t> ids, std::span<const float> reaches) {
    if constexpr (requires { subject_.set_reach(ids, reaches); })
      call([&] { subject_.set_reach(ids, reaches); });
    for (std::size_t k = 0; k < ids.size(); ++k)
      reference_.set_reach(ids[k], reaches[reaches.size() == 1 ? 0 : k]);
  }
  void set_exclusions(std::span<const Pair> pairs) {
    call([&] { subject_.set_exclusions(pairs); });
    reference_.set_exclusions(pairs);
  }
  void remove(std::uint32_t id) {
    call([&] { subject_.remove(id); });
    reference_.remove(id);
  }
  /// Several at once.
  void add(std::span<const Aabb> boxes, std::span<const Filter> filters) {
    const std::vector<std::uint32_t> ids = call([&] { return subject_.add(BoxView(boxes), filters); });
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      expect_equal("a new id", ids[k], reference_.add(boxes[k], filters[k]));
    }
  }
  void move(std::span<const std::uint32_t> ids, std::span<const Aabb> boxes) {
    call([&] { subject_.move(ids, BoxView(boxes)); });
    for (std::size_t k = 0; k < boxes.size(); ++k) reference_.move(ids[k], boxes[k]);
  }
  void remove(std::span<const std::uint32_t> ids) {
    call([&] { subject_.remove(ids); });
    for (const std::uint32_t id : ids) reference_.remove(id);
  }
  /// Maps n boxes and has `write` write them, for each of the two. Either may have any empty box in place of
  /// an empty one.
  template <class Function>
  void map(std::size_t n, const Function& write) {
    const std::span<Aabb> mapped = call([&] { return subject_.map(n); });
    reference_.map(n);
    std::vector<Aabb> boxes;
    for (std::uint32_t k = 0; k < n; ++k) boxes.push_back(reference_.box(k));
    write(std::span(boxes));
    write(mapped);
    for (std::uint32_t k = 0; k < n; ++k) reference_.move(k, boxes[k]);
  }
  void begin() {
    call([&] { subject_.begin(); });
    reference_.begin();
  }
  /// Begins an update with these boxes for all objects.
  void begin(const BoxView& boxes) {
    call([&] { subject_.begin(boxes); });
    set_all(boxes);
    reference_.begin();
  }
  void shrink() {
    call([&] { subject_.shrink(); });
  }

  /// Ends an update, which begins now unless it was begun already. The result is whether changes, all pairs,
  /// the size and all ids since the last update are right.
  [[nodiscard]] ::testing::AssertionResult agree() {
    return agree([](const auto& /*delta*/) {});
  }
  /// @param with Called with the changes that the subject reports.
  template <class Function>
  [[nodiscard]] ::testing::AssertionResult agree(const Function& with) {
    const auto delta = trouble_.call([&] { return finish(); }, [this] { note_failure(); });
    return agree(with, delta, reference_.finish());
  }
  /// An update with these boxes for all objects.
  template <class Function>
  [[nodiscard]] ::testing::AssertionResult agree(const BoxView& boxes, const Function& with) {
    const auto delta = trouble_.call([&] { return subject_.update(boxes); }, [this] { note_failure(); });
    set_all(boxes);
    return agree(with, delta, reference_.finish());
  }

  /// The states of both.
  [[nodiscard]] auto save() {
    return std::pair(call([&] { return subject_.save(); }), reference_.save());
  }
  /// The result is whether changes, all pairs, and all objects are right.
  template <class Saved>
  [[nodiscard]] ::testing::AssertionResult restore(const std::pair<Saved, Reference::State>& saved) {
    const auto delta =
        trouble_.call([&] { return restore_to(subject_, saved.first); }, [this] { note_failure(); });
    const ::testing::AssertionResult result =
        agree([](const auto& /*delta*/) {}, delta, reference_.restore(saved.second));
    return result ? has_same_objects() : result;
  }

  /// An update of the subject failed. The next one must find what changed since the last success.
  void note_failure() {
    reference_.abandon();  // an update that was begun is over
    look();
    constexpr std::uint32_t replaced = 0;
    if (reference_.contains(replaced)) {
      const Aabb box = reference_.box(replaced);
      const Filter filter = reference_.filter(replaced);
      subject_.remove(replaced);
      reference_.remove(replaced);
      expect_equal("the id of another object", subject_.add(box, filter), reference_.add(box, filter));
    }
    if (reference_.contains(1)) {
      Aabb box = reference_.box(1);
      box.upper[0] = std::nextafter(box.upper[0], box.lower[0]);
      subject_.move(1, box);
      reference_.move(1, box);
    }
  }

  /// The subject was updated by itself.
  void note_update() { (void)reference_.finish(); }

  [[nodiscard]] Subject& tested() noexcept { return subject_; }
  [[nodiscard]] const Reference& reference() const noexcept { return reference_; }
  [[nodiscard]] const Trouble& trouble() const noexcept { return trouble_; }
  void set_trouble(const Trouble& trouble) { trouble_ = trouble; }
  /// As of the last update, of both.
  [[nodiscard]] Pairs pairs() const { return reference_.pairs(); }

  /// Whether the subject has the ids, boxes and filters of the reference.
  [[nodiscard]] ::testing::AssertionResult has_same_objects() {
    compare_objects();
    if (is_right()) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure() << std::exchange(wrong_, "");
  }

 private:
  template <class Function, class Changes>
  [[nodiscard]] ::testing::AssertionResult agree(const Function& with, const Changes& delta,
                                                 const Reference::Changes& expected) {
    expect(same("added", delta.added, expected.added));
    expect(same("removed", delta.removed, expected.removed));
    with(delta);
    expect_equal("the size", subject_.size(), reference_.size());
    if (is_right()) expect(same("pairs", call([&] { return subject_.pairs(); }), reference_.pairs()));
    if (is_right()) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure() << std::exchange(wrong_, "");
  }

  [[nodiscard]] auto finish() {
    if constexpr (requires { subject_.update(); }) {
      if (!reference_.is_in_flight()) return subject_.update();
    }
    return subject_.finish();
  }

  void set_all(const BoxView& boxes) {
    reference_.map(boxes.size());
    for (std::uint32_t k = 0; k < boxes.size(); ++k) reference_.move(k, boxes[k]);
  }

  template <class Function>
  auto call(const Function& function) {
    return trouble_.call(function, [this] { look(); });
  }

  void compare_objects() {
    for (std::uint32_t id = 0; id < reference_.slots() + 2; ++id) {
      const bool is_there = reference_.contains(id);
      if (subject_.contains(id) != is_there) return expect(wrong("whether it is there", id));
      if (!is_there) continue;
      const Aabb box = subject_.box(id);
      const Aabb& expected = reference_.box(id);
      if (is_empty(box) ? !is_empty(expected) : box != expected) return expect(wrong("the box", id));
      if (has_reaches() && reach_of(id) != reference_.reach(id)) return expect(wrong("the reach", id));
      if (subject_.filter(id) != reference_.filter(id)) return expect(wrong("the filter", id));
    }
    if constexpr (requires {
                    { subject_.filters() } -> std::same_as<std::vector<Filter>>;
                  })
      compare_arrays();
  }
  /// Those of a subject that has what it was told of each object.
  void compare_arrays() {
    const std::vector<std::uint32_t> ids = reference_.ids();
    const std::vector<Aabb> boxes = subject_.boxes();
    const std::vector<Filter> filters = subject_.filters();
    std::vector<float> reaches(ids.size());
    if constexpr (requires { subject_.reaches(); }) reaches = subject_.reaches();
    if (subject_.ids() != ids) return expect(::testing::AssertionFailure() << "other ids");
    if (boxes.size() != ids.size() || filters.size() != ids.size() || reaches.size() != ids.size())
      return expect(::testing::AssertionFailure() << "other numbers of objects");
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (boxes[k] != subject_.box(ids[k])) return expect(wrong("among all, the box", ids[k]));
      if (filters[k] != reference_.filter(ids[k])) return expect(wrong("among all, the filter", ids[k]));
      if (has_reaches() && reaches[k] != reference_.reach(ids[k]))
        return expect(wrong("among all, the reach", ids[k]));
    }
    expect(same("exclusions", subject_.exclusions(), reference_.exclusions()));
  }
  [[nodiscard]] float reach_of(std::uint32_t id) const {
    if constexpr (requires { subject_.reach(id); }) {
      return subject_.reach(id);
    } else {
      return 0;
    }
  }
  [[nodiscard]] static ::testing::AssertionResult wrong(const char* what, std::uint32_t id) {
    return ::testing::AssertionFailure() << what << " of object " << id;
  }

  /// Nothing that a caller can see may have changed.
  void look() {
    expect_equal("the size", subject_.size(), reference_.size());
    if constexpr (requires { subject_.contains(0U); }) compare_objects();
    if (looks_ && !reference_.is_in_flight()) expect(same("known", subject_.pairs(), reference_.pairs()));
  }

  /// Remembers the first thing that is wrong.
  void expect(const ::testing::AssertionResult& result) {
    if (!result && is_right()) wrong_ = result.message();
  }
  void expect_equal(const char* what, std::size_t is, std::size_t expected) {
    if (is != expected && is_right())
      wrong_ = std::string(what) + " is " + std::to_string(is) + ", expected " + std::to_string(expected);
  }
  [[nodiscard]] bool is_right() const { return wrong_.empty(); }

  Subject subject_;
  Reference reference_;
  Trouble trouble_{};
  bool looks_ = false;
  std::string wrong_;
};

}  // namespace broadcl::test
