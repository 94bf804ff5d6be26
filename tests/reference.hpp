#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <set>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

namespace broadcl::test {

/// What a BroadPhase must answer, by the definitions of overlaps(), may_pair() and exclusions alone.
class Reference {
 public:
  struct Changes {
    std::vector<Pair> added;
    std::vector<Pair> removed;
  };

  std::uint32_t add(const Aabb& box, const Filter& filter = {}) {
    std::vector<Object>& objects = now_.objects;
    const auto free =
        std::find_if(objects.begin(), objects.end(), [](const Object& object) { return object.birth == 0; });
    const auto id = static_cast<std::uint32_t>(free - objects.begin());
    if (free == objects.end()) objects.emplace_back();
    objects[id] = {.box = box, .filter = filter, .birth = ++births_};
    return id;
  }
  void move(std::uint32_t id, const Aabb& box) { now_.objects[id].box = box; }
  void set_filter(std::uint32_t id, const Filter& filter) { now_.objects[id].filter = filter; }
  void set_exclusions(std::span<const Pair> pairs) {
    now_.exclusions.clear();
    for (const Pair& pair : pairs)
      now_.exclusions.insert({std::min(pair.a, pair.b), std::max(pair.a, pair.b)});
  }
  void remove(std::uint32_t id) { now_.objects[id] = {}; }

  /// New objects have an empty box until they are moved.
  void map(std::size_t n) {
    now_.objects.resize(n);
    for (Object& object : now_.objects) {
      if (object.birth == 0) object = {.box = {{1, 1, 1}, {0, 0, 0}}, .filter = {}, .birth = ++births_};
    }
  }

  void begin() {
    if (!begun_) begun_ = now_;
  }
  /// The update that was begun failed.
  void abandon() { begun_.reset(); }

  /// As of begin(), or now if nothing was begun.
  Changes finish() {
    std::vector<Met> now = pairs_of(begun_ ? *begun_ : now_);
    begun_.reset();
    Changes changes{.added = pairs_in_first(now, known_), .removed = pairs_in_first(known_, now)};
    known_ = std::move(now);
    return changes;
  }

  /// As of the last update.
  [[nodiscard]] std::vector<Pair> pairs() const { return pairs_in_first(known_, {}); }
  [[nodiscard]] std::size_t size() const { return ids().size(); }
  /// One more than the highest id.
  [[nodiscard]] std::size_t slots() const { return ids().empty() ? 0 : ids().back() + 1; }
  /// Of all objects, ascending.
  [[nodiscard]] std::vector<std::uint32_t> ids() const {
    std::vector<std::uint32_t> ids;
    for (std::uint32_t id = 0; id < now_.objects.size(); ++id) {
      if (now_.objects[id].birth > 0) ids.push_back(id);
    }
    return ids;
  }
  [[nodiscard]] const Aabb& box(std::uint32_t id) const { return now_.objects[id].box; }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const { return now_.objects[id].filter; }
  [[nodiscard]] bool is_in_flight() const { return begun_.has_value(); }

 private:
  struct Object {
    Aabb box{};
    Filter filter{};
    int birth = 0;  // 0 for none; a reused id is another object
  };
  struct State {
    std::vector<Object> objects;
    std::set<Pair> exclusions;
  };
  /// Two objects that overlap, in canonical order.
  struct Met {
    Pair pair;
    int birth_a;
    int birth_b;
    friend bool operator<(const Met& s, const Met& t) {
      return std::tie(s.pair, s.birth_a, s.birth_b) < std::tie(t.pair, t.birth_a, t.birth_b);
    }
  };

  static std::vector<Met> pairs_of(const State& state) {
    const std::vector<Object>& objects = state.objects;
    std::vector<std::uint32_t> living;
    for (std::uint32_t id = 0; id < objects.size(); ++id) {
      if (objects[id].birth > 0 && !is_empty(objects[id].box)) living.push_back(id);
    }
    std::vector<Met> pairs;
    for (const std::uint32_t b : living) {
      for (const std::uint32_t a : living) {
        if (a == b) break;
        const Object& s = objects[a];
        const Object& t = objects[b];
        if (overlaps(s.box, t.box) && may_pair(s.filter, t.filter) && !state.exclusions.contains({a, b}))
          pairs.push_back({{a, b}, s.birth, t.birth});
      }
    }
    return pairs;
  }

  static std::vector<Pair> pairs_in_first(const std::vector<Met>& first, const std::vector<Met>& second) {
    std::vector<Met> met;
    std::set_difference(first.begin(), first.end(), second.begin(), second.end(), std::back_inserter(met));
    std::vector<Pair> pairs(met.size());
    std::transform(met.begin(), met.end(), pairs.begin(), [](const Met& one) { return one.pair; });
    return pairs;
  }

  State now_;
  std::optional<State> begun_;
  std::vector<Met> known_;
  int births_ = 0;
};

}  // namespace broadcl::test
