#include "bullet_random_script.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <string_view>
#include <utility>

namespace broadcl::test {
namespace {

constexpr std::array<std::string_view, 17> verb_names{
    "create",   "destroy",     "recreate",        "move",  "set again", "filter",
    "callback", "remove pair", "remove pairs of", "clean", "add again", "begin",
    "step",     "rays",        "box queries",     "reset", "clear"};
constexpr std::array<std::string_view, 5> cache_names{"its own", "a hashed", "a user's class of", "a sorted",
                                                      "a null"};

constexpr int high_bit = std::numeric_limits<int>::min();
constexpr std::array groups{1, 2, 3, high_bit, 0};
constexpr std::array masks{-1, 1, 2, high_bit, 0};

/// How often each verb is chosen, if there are proxies.
struct Weight {
  Verb verb;
  unsigned weight;
};
constexpr std::array weights{Weight{Verb::create, 60},
                             Weight{Verb::destroy, 70},
                             Weight{Verb::recreate, 25},
                             Weight{Verb::move, 330},
                             Weight{Verb::set_again, 15},
                             Weight{Verb::filter, 50},
                             Weight{Verb::callback, 8},
                             Weight{Verb::remove_pair, 25},
                             Weight{Verb::remove_pairs_of, 8},
                             Weight{Verb::add_again, 10},
                             Weight{Verb::clean_pairs_of, 10},
                             Weight{Verb::begin, 45},
                             Weight{Verb::step, 100},
                             Weight{Verb::rays, 45},
                             Weight{Verb::box_queries, 45},
                             Weight{Verb::reset, 6},
                             Weight{Verb::clear, 2}};

class Generator {
 public:
  explicit Generator(const rc::Random& random) : random_(random) {}

  Script script(std::size_t length) {
    const bool is_crowd = one_in(12);
    target_ = is_crowd ? 250 : pick(std::array{3U, 10U, 40U, 60U});
    extent_ = is_crowd ? 16 + below(16) : pick(std::array{2U, 4U, 8U, 12U});
    odd_boxes_ = pick(std::array{0U, 2U, 20U});
    has_callbacks_ = one_in(2);
    // The most frequent cache is the one that most users have.
    const CacheKind cache = pick(std::array{CacheKind::own, CacheKind::own, CacheKind::own, CacheKind::hashed,
                                            CacheKind::users_class, CacheKind::sorted, CacheKind::sorted});
    Script script{.cache = one_in(30) ? CacheKind::null : cache, .ops = {}};
    while (script.ops.size() < length) script.ops.push_back(op());
    return script;
  }

 private:
  unsigned below(unsigned n) { return static_cast<unsigned>(random_.next() % n); }
  bool one_in(unsigned n) { return below(n) == 0; }
  template <class T, std::size_t N>
  T pick(const std::array<T, N>& values) {
    return values[below(N)];
  }

  Verb verb() {
    if (live_ < target_ && one_in(3)) return Verb::create;
    constexpr unsigned sum = std::accumulate(weights.begin(), weights.end(), 0U,
                                             [](unsigned s, Weight w) { return s + w.weight; });
    unsigned place = below(sum);
    const auto* row = weights.begin();
    while (place >= row->weight) place -= (row++)->weight;
    const bool is_wanted = row->verb != Verb::callback || has_callbacks_;
    return is_wanted ? row->verb : Verb::step;
  }

  BoxSpec box() {
    BoxSpec spec;
    for (int& x : spec.corner) x = static_cast<int>(below(extent_));
    for (int& x : spec.size) x = static_cast<int>(below(5));
    if (one_in(30)) spec.size = {40, 40, 40};
    if (below(100) < odd_boxes_)
      spec.shape = static_cast<Shape>(1 + below(static_cast<unsigned>(Shape::nan_upper)));
    spec.axis = below(3);
    return spec;
  }

  /// The number of proxies for a call: mostly one, sometimes all.
  unsigned count() {
    if (one_in(15)) return target_;
    return one_in(8) ? 2 + below(8) : 1;
  }

  Op op() {
    Op op{.verb = verb(), .which = below(1000), .box = box()};
    if (one_in(4)) {
      op.group = pick(groups);
      op.mask = pick(masks);
    }
    const bool many = op.verb == Verb::create || op.verb == Verb::move || op.verb == Verb::filter;
    const bool queries = op.verb == Verb::rays || op.verb == Verb::box_queries;
    if (many) op.count = count();
    if (queries) op.count = one_in(3) ? 8 : 1;  // enough to make a tree worthwhile, or too few
    if (op.verb == Verb::create) live_ += op.count;
    if (op.verb == Verb::destroy && live_ > 0) --live_;
    if (op.verb == Verb::clear) live_ = 0;
    return op;
  }

  rc::Random random_;
  unsigned live_ = 0;
  unsigned target_ = 0;     // proxies
  unsigned extent_ = 1;     // of the corners, in halves
  unsigned odd_boxes_ = 0;  // per cent
  bool has_callbacks_ = false;
};

/// Simpler operations of the same verb, the simplest first.
std::vector<Op> plainer(const Op& op) {
  std::vector<Op> result;
  const auto offer = [&](auto&& change) {
    Op changed = op;
    change(changed);
    if (changed != op) result.push_back(changed);
  };
  offer([](Op& o) { o = {.verb = o.verb, .which = o.which, .count = o.count, .box = {.size = {1, 1, 1}}}; });
  offer([](Op& o) { o.count = 1; });
  offer([](Op& o) { o.count = (o.count + 1) / 2; });
  offer([](Op& o) { o.count -= o.count > 1 ? 1 : 0; });
  offer([](Op& o) { o.which = 0; });
  offer([](Op& o) { o.which /= 2; });
  offer([](Op& o) { o.box.shape = Shape::ordinary; });
  offer([](Op& o) { o.box.axis = 0; });
  offer([](Op& o) { o.box.corner = {}; });
  offer([](Op& o) { o.box.size = {1, 1, 1}; });
  offer([](Op& o) { o.group = 1; });
  offer([](Op& o) { o.mask = -1; });
  return result;
}

/// Leaves out half of a script, then a quarter, and so on down to single operations; then makes one operation
/// simpler. (rapidcheck's own shrinking tries chunks of every length, which takes hours for long scripts.)
class Shrinks {
 public:
  explicit Shrinks(Script script) : script_(std::move(script)), chunk_((script_.ops.size() + 1) / 2) {}

  rc::Maybe<Script> operator()() {
    if (!std::exchange(cache_was_tried_, true) && script_.cache != CacheKind::own) {
      return Script{.cache = CacheKind::own, .ops = script_.ops};
    }
    const std::size_t n = script_.ops.size();
    if (chunk_ > 0 && n > 0) {
      Script shorter = script_;
      const auto first = shorter.ops.begin() + static_cast<std::ptrdiff_t>(start_);
      shorter.ops.erase(first, first + static_cast<std::ptrdiff_t>(std::min(chunk_, n - start_)));
      start_ += chunk_;
      if (start_ >= n) {
        start_ = 0;
        chunk_ = chunk_ == 1 ? 0 : (chunk_ + 1) / 2;
      }
      return shorter;
    }
    for (; place_ < n; ++place_, next_ = 0) {
      const std::vector<Op> ops = plainer(script_.ops[place_]);
      if (next_ == ops.size()) continue;
      Script changed = script_;
      changed.ops[place_] = ops[next_++];
      return changed;
    }
    return rc::Nothing;
  }

 private:
  Script script_;
  bool cache_was_tried_ = false;
  std::size_t chunk_;
  std::size_t start_ = 0;
  std::size_t place_ = 0;
  std::size_t next_ = 0;
};

std::ostream& operator<<(std::ostream& out, const btVector3& v) {
  return out << "(" << v.x() << ", " << v.y() << ", " << v.z() << ")";
}

}  // namespace

Corners corners(const BoxSpec& spec) {
  constexpr btScalar infinity = std::numeric_limits<btScalar>::infinity();
  constexpr btScalar nan = std::numeric_limits<btScalar>::quiet_NaN();
  constexpr auto largest = btScalar{std::numeric_limits<float>::max()};
  const btScalar parts = spec.shape == Shape::thirds ? 3 : 2;
  const auto scaled = [&](int x, int y, int z) {
    return btVector3(btScalar(x) / parts, btScalar(y) / parts, btScalar(z) / parts);
  };
  const auto& [x, y, z] = spec.corner;
  Corners box{.lower = scaled(x, y, z),
              .upper = scaled(x + spec.size[0], y + spec.size[1], z + spec.size[2])};
  btScalar& lower = box.lower[static_cast<int>(spec.axis)];
  btScalar& upper = box.upper[static_cast<int>(spec.axis)];
  const auto all = [&](btScalar bound) { box = {{-bound, -bound, -bound}, {bound, bound, bound}}; };
  switch (spec.shape) {
    case Shape::ordinary:
    case Shape::thirds:
      break;
    case Shape::far:
      lower += 1000;
      upper += 1000;
      break;
    case Shape::plane: {
      const btVector3 wide(btScalar(1e18), btScalar(1e18), btScalar(1e18));
      const auto [from, to] = std::pair(lower, upper);
      box = {-wide, wide};
      lower = from;
      upper = to;
      break;
    }
    case Shape::largest:
      all(largest);
      break;
    case Shape::everywhere:
      all(infinity);
      break;
    case Shape::half_infinite:
      upper = infinity;
      break;
    case Shape::at_infinity:
      lower = upper = infinity;
      break;
    case Shape::inverted:
      lower = upper + 1;
      break;
    case Shape::inside_out:
      all(-largest);
      break;
    case Shape::nan_lower:
      lower = nan;
      break;
    case Shape::nan_upper:
      upper = nan;
      break;
  }
  return box;
}

BoxSpec box_of_call(const Op& op, unsigned k) {
  constexpr int wrap = 24;
  BoxSpec box = op.box;
  if (k == 0) return box;
  const auto step = static_cast<int>(k);
  box.corner = {(box.corner[0] + 7 * step) % wrap, (box.corner[1] + 3 * step) % wrap,
                (box.corner[2] + 5 * step + step / wrap) % wrap};
  return box;
}

std::ostream& operator<<(std::ostream& out, const Op& op) {
  const bool has_box = op.verb == Verb::create || op.verb == Verb::move || op.verb == Verb::rays ||
                       op.verb == Verb::box_queries;
  const bool has_filter = op.verb == Verb::create || op.verb == Verb::recreate || op.verb == Verb::filter;
  const bool has_object = op.verb != Verb::create && op.verb != Verb::begin && op.verb != Verb::step &&
                          op.verb != Verb::box_queries && op.verb != Verb::reset && op.verb != Verb::clear;
  out << verb_names[static_cast<std::size_t>(op.verb)];
  if (has_object) out << " " << op.which;
  if (op.count > 1) out << ", " << op.count << " times";
  if (has_box) out << ", " << corners(op.box).lower << " to " << corners(op.box).upper;
  if (has_filter) out << ", group " << op.group << ", mask " << op.mask;
  return out;
}

std::ostream& operator<<(std::ostream& out, const Script& script) {
  out << "with " << cache_names[static_cast<std::size_t>(script.cache)] << " pair cache\n";
  for (std::size_t k = 0; k < script.ops.size(); ++k) out << "  " << k << ": " << script.ops[k] << "\n";
  return out;
}

rc::Gen<Script> scripts(std::size_t length) {
  return [length](const rc::Random& random, int /*size*/) {
    return rc::shrinkable::shrinkRecur(Generator(random).script(length),
                                       [](const Script& script) { return rc::Seq<Script>(Shrinks(script)); });
  };
}

}  // namespace broadcl::test
