#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

namespace broadcl::test {

/// What a BroadPhase must answer, by the definitions of overlaps() and may_pair() alone.
class Reference {
 public:
  struct Changes {
    std::vector<Pair> added;
    std::vector<Pair> removed;
  };

  std::uint32_t add(const Aabb& box, const Filter& filter = {}) {
    const auto free = std::find_if(objects_.begin(), objects_.end(),
                                   [](const Object& object) { return object.birth == 0; });
    const auto id = static_cast<std::uint32_t>(free - objects_.begin());
    if (free == objects_.end()) objects_.emplace_back();
    objects_[id] = {.box = box, .filter = filter, .birth = ++births_};
    return id;
  }
  void move(std::uint32_t id, const Aabb& box) { objects_[id].box = box; }
  void set_filter(std::uint32_t id, const Filter& filter) { objects_[id].filter = filter; }
  void remove(std::uint32_t id) { objects_[id] = {}; }

  /// New objects have an empty box until they are moved.
  void map(std::size_t n) {
    objects_.resize(n);
    for (Object& object : objects_) {
      if (object.birth == 0) object = {.box = {{1, 1, 1}, {0, 0, 0}}, .filter = {}, .birth = ++births_};
    }
  }

  void begin() {
    if (!begun_) begun_ = objects_;
  }
  /// The update that was begun failed.
  void abandon() { begun_.reset(); }

  /// As of begin(), or now if nothing was begun.
  Changes finish() {
    std::vector<Met> now = pairs_of(begun_ ? *begun_ : objects_);
    begun_.reset();
    Changes changes{.added = pairs_in_first(now, known_), .removed = pairs_in_first(known_, now)};
    known_ = std::move(now);
    return changes;
  }

  /// As of the last update.
  [[nodiscard]] std::vector<Pair> pairs() const { return pairs_in_first(known_, {}); }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(std::count_if(objects_.begin(), objects_.end(),
                                                  [](const Object& object) { return object.birth > 0; }));
  }
  [[nodiscard]] bool is_in_flight() const { return begun_.has_value(); }

 private:
  struct Object {
    Aabb box{};
    Filter filter{};
    int birth = 0;  // 0 for none; a reused id is another object
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

  static std::vector<Met> pairs_of(const std::vector<Object>& objects) {
    std::vector<Met> pairs;
    for (std::uint32_t b = 0; b < objects.size(); ++b) {
      for (std::uint32_t a = 0; a < b; ++a) {
        const Object& s = objects[a];
        const Object& t = objects[b];
        if (s.birth > 0 && t.birth > 0 && !is_empty(s.box) && !is_empty(t.box) && overlaps(s.box, t.box) &&
            may_pair(s.filter, t.filter)) {
          pairs.push_back({{a, b}, s.birth, t.birth});
        }
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

  std::vector<Object> objects_;
  std::optional<std::vector<Object>> begun_;
  std::vector<Met> known_;
  int births_ = 0;
};

}  // namespace broadcl::test
