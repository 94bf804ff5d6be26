#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <tuple>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

namespace broadcl::test {

/// What a BroadPhase must answer, by the definitions of overlaps(), are_near(), may_pair() and
/// exclusions alone.
class Reference {
 public:
  struct Changes {
    std::vector<Pair> added;
    std::vector<Pair> removed;
  };

  struct Object {
    Aabb box{};
    Filter filter{};
    float reach = 0;
    int birth = 0;  // 0 for none; a reused id is another object
  };
  /// What is saved.
  struct State {
    std::vector<Object> objects;
    std::set<Pair> exclusions;
  };

  std::uint32_t add(const Aabb& box, const Filter& filter = {});
  void move(std::uint32_t id, const Aabb& box) { now_.objects[id].box = box; }
  void set_filter(std::uint32_t id, const Filter& filter) { now_.objects[id].filter = filter; }
  void set_reach(std::uint32_t id, float reach) { now_.objects[id].reach = reach; }
  void set_exclusions(std::span<const Pair> pairs);
  void remove(std::uint32_t id) { now_.objects[id] = {}; }

  /// New objects have an empty box until they are moved.
  void map(std::size_t n);

  void begin() {
    if (!begun_) begun_ = now_;
  }
  /// The update that was begun failed.
  void abandon() { begun_.reset(); }

  /// As of begin(), or now if nothing was begun.
  Changes finish();

  [[nodiscard]] State save() const { return now_; }
  Changes restore(const State& saved);
  /// Whether some object is not as of the last update.
  [[nodiscard]] bool has_changed() const;

  /// As of the last update.
  [[nodiscard]] std::vector<Pair> pairs() const;
  [[nodiscard]] std::size_t size() const { return ids().size(); }
  /// One more than the highest id.
  [[nodiscard]] std::size_t slots() const { return ids().empty() ? 0 : ids().back() + 1; }
  /// Of all objects, ascending.
  [[nodiscard]] std::vector<std::uint32_t> ids() const;
  [[nodiscard]] bool contains(std::uint32_t id) const {
    return id < now_.objects.size() && now_.objects[id].birth > 0;
  }
  [[nodiscard]] const Aabb& box(std::uint32_t id) const { return now_.objects[id].box; }
  [[nodiscard]] const Filter& filter(std::uint32_t id) const { return now_.objects[id].filter; }
  [[nodiscard]] float reach(std::uint32_t id) const { return now_.objects[id].reach; }
  [[nodiscard]] std::vector<Pair> exclusions() const {
    return {now_.exclusions.begin(), now_.exclusions.end()};
  }
  [[nodiscard]] bool is_in_flight() const { return begun_.has_value(); }

 private:
  /// Two objects that overlap, in canonical order.
  struct Met {
    Pair pair;
    int birth_a;
    int birth_b;
    friend bool operator<(const Met& s, const Met& t) {
      return std::tie(s.pair, s.birth_a, s.birth_b) < std::tie(t.pair, t.birth_a, t.birth_b);
    }
  };

  static std::vector<Met> pairs_of(const State& state);
  static std::vector<Pair> pairs_in_first(const std::vector<Met>& first, const std::vector<Met>& second);

  State now_;
  State last_;  // of the last update
  std::optional<State> begun_;
  std::vector<Met> known_;
  int births_ = 0;
};

}  // namespace broadcl::test
