#include "core_random_script.hpp"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <numeric>
#include <string_view>

namespace broadcl::test {
namespace {

constexpr std::array<std::string_view, 22> core_verb_names{
    "add",         "remove", "replace", "move",     "map",     "give",  "drift",  "stir",
    "filter",      "reach",  "ask",     "partners", "exclude", "begin", "update", "enqueue",
    "change side", "fail",   "shrink",  "save",     "restore", "refuse"};
constexpr std::array<std::string_view, 7> filter_kind_names{
    "no", "levels as", "groups as", "worlds as", "sets as", "sets of worlds as", "all kinds of"};

/// Of exclusions: 0 none, 1 few, others many.
constexpr unsigned exclusion_kinds = 6;

/// How often each verb is chosen, if there are objects.
struct CoreWeight {
  CoreVerb verb;
  unsigned weight;
};
constexpr std::array core_weights{CoreWeight{CoreVerb::add, 20},         CoreWeight{CoreVerb::remove, 30},
                                  CoreWeight{CoreVerb::replace, 30},     CoreWeight{CoreVerb::move, 300},
                                  CoreWeight{CoreVerb::map, 15},         CoreWeight{CoreVerb::give, 30},
                                  CoreWeight{CoreVerb::drift, 15},       CoreWeight{CoreVerb::stir, 15},
                                  CoreWeight{CoreVerb::filter, 40},      CoreWeight{CoreVerb::reach, 30},
                                  CoreWeight{CoreVerb::ask, 60},         CoreWeight{CoreVerb::partners, 10},
                                  CoreWeight{CoreVerb::exclude, 60},     CoreWeight{CoreVerb::begin, 60},
                                  CoreWeight{CoreVerb::update, 300},     CoreWeight{CoreVerb::enqueue, 120},
                                  CoreWeight{CoreVerb::change_side, 60}, CoreWeight{CoreVerb::fail, 40},
                                  CoreWeight{CoreVerb::shrink, 15},      CoreWeight{CoreVerb::save, 30},
                                  CoreWeight{CoreVerb::restore, 40},     CoreWeight{CoreVerb::refuse, 20}};

class CoreGenerator {
 public:
  explicit CoreGenerator(const rc::Random& random) : dice_(random) {}

  CoreScript script(ScriptSize size) {
    CoreScript script;
    std::size_t length = 200;
    script.most = dice_.pick(std::array{3U, 10U, 40U, 60U, 60U});
    script.extent = dice_.pick(std::array{1, 1, 2, 3, 4, 8});
    if (size == ScriptSize::tiny) {
      length = 10;
      script.most = dice_.pick(std::array{10U, 40U});
    } else if (dice_.one_in(4)) {
      length = 50;
      script.most = 250;
      script.extent = dice_.pick(std::array{1, 16});
    } else if (dice_.one_in(20)) {
      length = 40;
      script.most = 600;
      script.extent = 32;
    } else if (dice_.one_in(30)) {
      length = 15;
      script.most = 2300;
      script.extent = 64;
    }
    script.filters = dice_.one_in(2) ? FilterKind::none : static_cast<FilterKind>(1 + dice_.below(6));
    script.warp = dice_.below(1000);
    script.is_flat = dice_.one_in(8);
    script.part = dice_.pick(std::array{64U, 2048U});
    odd_boxes_ = dice_.pick(std::array{0U, 0U, 3U, 20U});
    is_lively_ = dice_.one_in(2);
    grows_slowly_ = dice_.one_in(3);
    while (script.ops.size() < length) {
      const CoreVerb next = live_ < script.most && dice_.one_in(4) ? CoreVerb::add : verb();
      script.ops.push_back(op(script, next, count(next, script.most)));
      if (next == CoreVerb::save && dice_.one_in(2)) go_back_soon(script);
      if (next == CoreVerb::map && dice_.one_in(2))
        push_some(script, {CoreVerb::give, CoreVerb::give, CoreVerb::move, CoreVerb::fail, CoreVerb::map,
                           CoreVerb::update});
      if (next != CoreVerb::give || !dice_.one_in(3)) continue;
      CoreOp few = op(script, CoreVerb::exclude, 1);  // perhaps of ids that are free now
      few.filter = few.filter / exclusion_kinds * exclusion_kinds + 1;
      script.ops.push_back(few);
    }
    return script;
  }

 private:
  /// Some operations that add and remove no objects.
  void push_some(CoreScript& script, std::initializer_list<CoreVerb> verbs) {
    for (unsigned k = dice_.below(5); k > 0; --k) {
      const CoreVerb verb = verbs.begin()[dice_.below(static_cast<unsigned>(verbs.size()))];
      const bool is_of_all = verb == CoreVerb::give || verb == CoreVerb::map;
      script.ops.push_back(op(script, verb, is_of_all ? 1 : count(verb, script.most)));
    }
  }

  /// Goes back to what was saved last, before other objects are there.
  void go_back_soon(CoreScript& script) {
    push_some(script, {CoreVerb::move, CoreVerb::move, CoreVerb::give, CoreVerb::stir, CoreVerb::ask,
                       CoreVerb::update});
    CoreOp back = op(script, CoreVerb::restore, 1);
    back.which = 5;  // the last, however many there are
    script.ops.push_back(back);
  }

  CoreVerb verb() {
    constexpr unsigned sum = std::accumulate(core_weights.begin(), core_weights.end(), 0U,
                                             [](unsigned s, CoreWeight w) { return s + w.weight; });
    unsigned place = dice_.below(sum);
    const auto* row = core_weights.begin();
    while (place >= row->weight) place -= (row++)->weight;
    return row->verb;
  }

  /// The number of objects for a call.
  unsigned count(CoreVerb verb, unsigned most) {
    const unsigned few = dice_.one_in(4) ? 2 + dice_.below(8) : 1;
    switch (verb) {
      case CoreVerb::add: {
        const unsigned count = !grows_slowly_ && dice_.one_in(2) ? most : few;
        live_ += count;
        return count;
      }
      case CoreVerb::map:
      case CoreVerb::give: {
        const unsigned many = dice_.one_in(3) ? 1 + dice_.below(most) : most;
        const unsigned count = dice_.one_in(4) ? few : many;
        if (count > 1) live_ = count;
        return count;
      }
      case CoreVerb::move:
        return dice_.one_in(is_lively_ ? 2 : 10) ? most : few;
      case CoreVerb::drift:
      case CoreVerb::stir:
        return 1 + dice_.below(8);
      case CoreVerb::filter:
      case CoreVerb::reach:
        return dice_.one_in(10) ? most : few;
      case CoreVerb::remove:
      case CoreVerb::replace: {
        const unsigned many = dice_.one_in(2) ? most : 1 + live_ * 9 / 10;
        const unsigned count = dice_.one_in(20) ? many : few;
        if (verb == CoreVerb::remove) live_ -= std::min(live_, count);
        return count;
      }
      default:
        return 1;
    }
  }

  CoreOp op(const CoreScript& script, CoreVerb verb, unsigned count) {
    return {.verb = verb,
            .which = dice_.below(1000),
            .count = count,
            .box = random_box(dice_, static_cast<unsigned>(script.extent), odd_boxes_),
            .filter = dice_.below(1000)};
  }

  Dice dice_;
  unsigned live_ = 0;
  unsigned odd_boxes_ = 0;  // per cent
  bool is_lively_ = false;  // often everything moves
  bool grows_slowly_ = false;
};

/// Simpler operations of the same verb, the simplest first.
std::vector<CoreOp> plainer_core_op(const CoreOp& op) {
  std::vector<CoreOp> result;
  const auto offer = [&](auto&& change) {
    CoreOp changed = op;
    change(changed);
    if (changed != op) result.push_back(changed);
  };
  offer([](CoreOp& o) {
    o = {.verb = o.verb, .which = o.which, .count = o.count, .box = {.size = {1, 1, 1}}};
  });
  offer([](CoreOp& o) { o.count = 1; });
  offer([](CoreOp& o) { o.count = (o.count + 1) / 2; });
  offer([](CoreOp& o) { o.count -= o.count > 1 ? 1 : 0; });
  offer([](CoreOp& o) { o.which = 0; });
  offer([](CoreOp& o) { o.which /= 2; });
  offer([](CoreOp& o) { o.box.shape = Shape::ordinary; });
  offer([](CoreOp& o) { o.box = {.size = {1, 1, 1}}; });
  offer([](CoreOp& o) { o.filter = 0; });
  return result;
}

/// With simpler settings.
std::vector<CoreScript> plainer_scripts(const CoreScript& script) {
  std::vector<CoreScript> result;
  const auto offer = [&](auto CoreScript::*setting) {
    CoreScript plain = script;
    plain.*setting = CoreScript().*setting;
    if (plain.*setting != script.*setting) result.push_back(plain);
  };
  offer(&CoreScript::filters);
  offer(&CoreScript::is_flat);
  offer(&CoreScript::part);
  return result;
}

std::ostream& operator<<(std::ostream& out, const Aabb& box) {
  for (const auto* corner : {&box.lower, &box.upper}) {
    out << (corner == &box.lower ? "(" : " to (") << (*corner)[0] << ", " << (*corner)[1] << ", "
        << (*corner)[2] << ")";
  }
  return out;
}

}  // namespace

Filter filter_of(FilterKind kind, unsigned number) {
  constexpr std::array groups{1U, 2U, 3U, 0x80000000U, 0U};
  constexpr std::array masks{0xffffffffU, 1U, 2U, 0x80000001U};
  constexpr std::array bodies{Filter::no_body, 0U, 1U};
  // (Some, or twice some, are the same as float32, or if they lose their highest bit.)
  constexpr std::array worlds{
      0U, 1U, 8'388'607U, 8'388'608U, 0x7ffffffeU, 0x80000001U, Filter::all_worlds - 1, Filter::all_worlds};
  const bool sets = kind == FilterKind::sets || kind == FilterKind::sets_of_worlds;
  const bool all = kind == FilterKind::all;
  Filter filter;
  if (sets) filter = number % 2 == 0 ? Filter::first_set : Filter::second_set;
  if (kind == FilterKind::levels) return number % 12 == 0 ? Filter() : Filter{.group = 2, .mask = ~2U};
  if (kind == FilterKind::groups || all) {
    filter = {.group = groups.at(number % 5), .mask = masks.at(number / 5 % 4)};
  }
  if (kind != FilterKind::none && kind != FilterKind::worlds) filter.body = bodies.at(number / 7 % 3);
  if (kind == FilterKind::worlds || kind == FilterKind::sets_of_worlds || all) {
    filter.world = worlds.at(number / 3 % worlds.size());
  }
  return filter;
}

Aabb box_of(const CoreScript& script, const CoreOp& op, unsigned k) {
  auto [lower, upper] = corners_of<float>(box_of_call(op.box, k, script.extent));
  if (script.is_flat) lower[2] = upper[2] = 0;
  return {lower, upper};
}

std::size_t mapped_of(const CoreScript& script, const CoreOp& op) {
  return op.filter % 10 == 0 ? 0 : std::min(op.count, script.most);
}

Filter filter_of(const CoreScript& script, const CoreOp& op, unsigned k) {
  return filter_of(script.filters, op.filter + 11 * k);
}

float reach_of(const CoreOp& op, unsigned k) {
  // (The sum of 1 / 3 and the next one is rounded up to 0.5.)
  constexpr std::array reaches{0.0F, 0.0F, 0.5F, 0.25F, 1 / 3.0F, 0x1.555552p-3F, 1.5F, 0x1p-64F};
  return reaches.at((op.filter + 5 * k) % reaches.size());
}

float drift_of(const CoreOp& op) {
  const float step = op.which % 7 == 0 ? 0x1p-21F : 0x1p-6F;  // perhaps one that float32 can just tell
  return static_cast<float>(1 + op.which % 5) * (op.which % 2 == 0 ? step : -step);
}

Aabb drifted(const CoreScript& script, Aabb box, float step) {
  for (std::size_t axis = 0; axis < (script.is_flat ? 2U : 3U); ++axis) {
    box.lower[axis] += step * static_cast<float>(1 + axis);
    box.upper[axis] += step * static_cast<float>(1 + axis);
  }
  return box;
}

void drift(const CoreScript& script, const CoreOp& op, std::span<Aabb> boxes, std::size_t stride) {
  for (std::size_t k = 0; k < boxes.size(); k += stride) boxes[k] = drifted(script, boxes[k], drift_of(op));
  if (boxes.empty() || op.filter % 3 != 0) return;
  Aabb& box = boxes[op.filter % boxes.size()];
  const Aabb other = box_of(script, op, 0);
  box = is_empty(box) && !has_nan(other) ? other : inverted;
}

std::optional<Aabb> stirred(const CoreScript& script, const CoreOp& op, unsigned update,
                            std::span<const Aabb> boxes, std::size_t k) {
  if (op.filter % 2 == 0) return boxes[(k + 1 + op.which) % boxes.size()];
  if ((k + update) % (1 + op.which % 20) != 0) return std::nullopt;
  const Aabb box = box_of(script, op, static_cast<unsigned>(k) + update);
  return has_nan(box) ? empty_aabb() : box;
}

Pairs exclusions_of(const CoreOp& op, const Pairs& present) {
  constexpr std::array<std::size_t, exclusion_kinds> steps{0, 0, 1, 3, 7, 50};
  const std::size_t step = steps.at(op.filter % exclusion_kinds);
  Pairs pairs;
  if (op.filter % exclusion_kinds == 0) return pairs;
  for (std::size_t k = op.which % 40; step > 0 && k < present.size(); k += step) pairs.push_back(present[k]);
  const std::uint32_t others = 1 + op.filter / exclusion_kinds % 4;
  for (std::uint32_t k = 0; k < others; ++k) pairs.push_back({8 + op.which % 40 + k, op.which % 7});
  pairs.push_back(pairs.front());
  if (op.which % 3 == 0) pairs.push_back({0, 0xffffffff});
  std::ranges::reverse(pairs);
  return pairs;
}

std::ostream& operator<<(std::ostream& out, const CoreOp& op) {
  out << core_verb_names.at(static_cast<std::size_t>(op.verb)) << " " << op.which;
  if (op.count > 1) out << ", " << op.count << " times";
  const auto [lower, upper] = corners_of<float>(op.box);
  return out << ", " << Aabb{lower, upper} << ", filter " << op.filter;
}

std::ostream& operator<<(std::ostream& out, const CoreScript& script) {
  out << "with at most " << script.most << (script.is_flat ? " flat" : "") << " objects in " << script.extent
      << " halves, and " << filter_kind_names.at(static_cast<std::size_t>(script.filters))
      << " filters, warp " << script.warp << ", parts of " << script.part << "\n";
  for (std::size_t k = 0; k < script.ops.size(); ++k) out << "  " << k << ": " << script.ops[k] << "\n";
  return out;
}

rc::Gen<CoreScript> core_scripts(ScriptSize size) {
  return [size](const rc::Random& random, int /*size*/) {
    return rc::shrinkable::shrinkRecur(CoreGenerator(random).script(size), [](const CoreScript& script) {
      return rc::Seq<CoreScript>(Shrinks<CoreScript, plainer_scripts, plainer_core_op>(script));
    });
  };
}

}  // namespace broadcl::test
