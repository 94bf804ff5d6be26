#include "reference.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "near.hpp"

namespace broadcl::test {

std::uint32_t Reference::add(const Aabb& box, const Filter& filter) {
  std::vector<Object>& objects = now_.objects;
  const auto free =
      std::find_if(objects.begin(), objects.end(), [](const Object& object) { return object.birth == 0; });
  const auto id = static_cast<std::uint32_t>(free - objects.begin());
  if (free == objects.end()) objects.emplace_back();
  objects[id] = {.box = box, .filter = filter, .reach = 0, .birth = ++births_};
  return id;
}

void Reference::set_exclusions(std::span<const Pair> pairs) {
  now_.exclusions.clear();
  for (const Pair& pair : pairs) now_.exclusions.insert({std::min(pair.a, pair.b), std::max(pair.a, pair.b)});
}

void Reference::map(std::size_t n) {
  now_.objects.resize(n);
  for (Object& object : now_.objects) {
    if (object.birth == 0)
      object = {.box = {{1, 1, 1}, {0, 0, 0}}, .filter = {}, .reach = 0, .birth = ++births_};
  }
}

Reference::Changes Reference::finish() {
  last_ = begun_ ? *begun_ : now_;
  std::vector<Met> now = pairs_of(last_);
  begun_.reset();
  Changes changes{.added = pairs_in_first(now, known_), .removed = pairs_in_first(known_, now)};
  known_ = std::move(now);
  return changes;
}

/// Which objects have a pair does not matter.
Reference::Changes Reference::restore(const State& saved) {
  const std::vector<Pair> before = pairs();
  now_ = saved;
  (void)finish();
  const std::vector<Pair> now = pairs();
  Changes changes;
  std::ranges::set_difference(now, before, std::back_inserter(changes.added));
  std::ranges::set_difference(before, now, std::back_inserter(changes.removed));
  return changes;
}

bool Reference::has_changed() const {
  for (std::size_t id = 0; id < std::max(now_.objects.size(), last_.objects.size()); ++id) {
    const Object s = id < now_.objects.size() ? now_.objects[id] : Object();
    const Object t = id < last_.objects.size() ? last_.objects[id] : Object();
    const bool same_box = is_empty(s.box) ? is_empty(t.box) : s.box == t.box;
    if (s.birth != t.birth || (s.birth > 0 && (!same_box || s.filter != t.filter || s.reach != t.reach)))
      return true;
  }
  return false;
}

std::vector<Pair> Reference::pairs() const {
  return pairs_in_first(known_, {});
}

std::vector<std::uint32_t> Reference::ids() const {
  std::vector<std::uint32_t> ids;
  for (std::uint32_t id = 0; id < now_.objects.size(); ++id) {
    if (now_.objects[id].birth > 0) ids.push_back(id);
  }
  return ids;
}

std::vector<Reference::Met> Reference::pairs_of(const State& state) {
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
      const bool reach = s.reach > 0 || t.reach > 0;
      if ((reach ? are_near(s.box, t.box, s.reach, t.reach) : overlaps(s.box, t.box)) &&
          may_pair(s.filter, t.filter) && !state.exclusions.contains({a, b}))
        pairs.push_back({{a, b}, s.birth, t.birth});
    }
  }
  return pairs;
}

std::vector<Pair> Reference::pairs_in_first(const std::vector<Met>& first, const std::vector<Met>& second) {
  std::vector<Met> met;
  std::set_difference(first.begin(), first.end(), second.begin(), second.end(), std::back_inserter(met));
  std::vector<Pair> pairs(met.size());
  std::transform(met.begin(), met.end(), pairs.begin(), [](const Met& one) { return one.pair; });
  return pairs;
}

}  // namespace broadcl::test
