#include "bullet_random_script.hpp"

#include <array>
#include <limits>
#include <numeric>
#include <string_view>

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
  explicit Generator(const rc::Random& random) : dice_(random) {}

  Script script(std::size_t length) {
    const bool is_crowd = dice_.one_in(12);
    target_ = is_crowd ? 250 : dice_.pick(std::array{3U, 10U, 40U, 60U});
    extent_ = is_crowd ? 16 + dice_.below(16) : dice_.pick(std::array{2U, 4U, 8U, 12U});
    odd_boxes_ = dice_.pick(std::array{0U, 2U, 20U});
    has_callbacks_ = dice_.one_in(2);
    // The most frequent cache is the one that most users have.
    const CacheKind cache =
        dice_.pick(std::array{CacheKind::own, CacheKind::own, CacheKind::own, CacheKind::hashed,
                              CacheKind::users_class, CacheKind::sorted, CacheKind::sorted});
    Script script{.cache = dice_.one_in(30) ? CacheKind::null : cache, .ops = {}};
    while (script.ops.size() < length) script.ops.push_back(op());
    return script;
  }

 private:
  Verb verb() {
    if (live_ < target_ && dice_.one_in(3)) return Verb::create;
    constexpr unsigned sum = std::accumulate(weights.begin(), weights.end(), 0U,
                                             [](unsigned s, Weight w) { return s + w.weight; });
    unsigned place = dice_.below(sum);
    const auto* row = weights.begin();
    while (place >= row->weight) place -= (row++)->weight;
    const bool is_wanted = row->verb != Verb::callback || has_callbacks_;
    return is_wanted ? row->verb : Verb::step;
  }

  /// The number of proxies for a call: mostly one, sometimes all.
  unsigned count() {
    if (dice_.one_in(15)) return target_;
    return dice_.one_in(8) ? 2 + dice_.below(8) : 1;
  }

  Op op() {
    Op op{.verb = verb(), .which = dice_.below(1000), .box = random_box(dice_, extent_, odd_boxes_)};
    if (dice_.one_in(4)) {
      op.group = dice_.pick(groups);
      op.mask = dice_.pick(masks);
    }
    const bool many = op.verb == Verb::create || op.verb == Verb::move || op.verb == Verb::filter;
    const bool queries = op.verb == Verb::rays || op.verb == Verb::box_queries;
    if (many) op.count = count();
    if (queries) op.count = dice_.one_in(3) ? 8 : 1;  // enough to make a tree worthwhile, or too few
    if (op.verb == Verb::create) live_ += op.count;
    if (op.verb == Verb::destroy && live_ > 0) --live_;
    if (op.verb == Verb::clear) live_ = 0;
    return op;
  }

  Dice dice_;
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

std::vector<Script> plainer_cache(const Script& script) {
  if (script.cache == CacheKind::own) return {};
  return {{.cache = CacheKind::own, .ops = script.ops}};
}

std::ostream& operator<<(std::ostream& out, const btVector3& v) {
  return out << "(" << v.x() << ", " << v.y() << ", " << v.z() << ")";
}

}  // namespace

Corners corners(const BoxSpec& spec) {
  const auto [lower, upper] = corners_of<btScalar>(spec);
  return {{lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}};
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
    return rc::shrinkable::shrinkRecur(Generator(random).script(length), [](const Script& script) {
      return rc::Seq<Script>(Shrinks<Script, plainer_cache, plainer>(script));
    });
  };
}

}  // namespace broadcl::test
