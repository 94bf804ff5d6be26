#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>

#include "base/box_parts.hpp"
#include "boxes.hpp"
#include "core_random_script.hpp"
#include "each_algorithm.hpp"
#include "expected_hits.hpp"
#include "expected_ranked_hits.hpp"
#include "kept_delta.hpp"
#include "random_scripts.hpp"
#include "rounding.hpp"
#include "twins.hpp"
#include "warped.hpp"

namespace broadcl::test {

/// While it exists, the host's loops have parts of so many boxes.
class ScopedPart {
 public:
  explicit ScopedPart(std::size_t boxes) noexcept { boxes_per_part = boxes; }
  ~ScopedPart() { boxes_per_part = before_; }
  ScopedPart(const ScopedPart&) = delete;
  ScopedPart& operator=(const ScopedPart&) = delete;
  ScopedPart(ScopedPart&&) = delete;
  ScopedPart& operator=(ScopedPart&&) = delete;

 private:
  std::size_t before_ = boxes_per_part;
};

/// Plays a script to a subject of Twins, in a rounding mode that depends on the operation.
template <class Subject>
class CorePlayer {
 public:
  CorePlayer(Subject& subject, const CoreScript& script)
      : part_(script.part),
        twins_(std::in_place, NoTrouble(), false, subject),
        subject_(subject),
        script_(script) {
    if constexpr (requires { subject.set_warp(Warp()); }) subject.set_warp(Warp(script.warp));
  }

  void apply(const CoreOp& op) {
    const ScopedRounding rounding(rounding_modes.at(rounds_ ? op.which % rounding_modes.size() : 0));
    const std::vector<std::uint32_t> ids = reference().ids();
    switch (op.verb) {
      case CoreVerb::add:
        if (op.which % 4 == 0) return add_several(op);
        for (unsigned k = 0; k < op.count && reference().size() < script_.most; ++k) {
          add(box_of(script_, op, k), filter_of(script_, op, k));
        }
        break;
      case CoreVerb::map:
        map(op);
        break;
      case CoreVerb::give:
        give(op);
        break;
      case CoreVerb::drift:
        for (unsigned k = 0; k < op.count && !reference().is_in_flight(); ++k) drift(op);
        break;
      case CoreVerb::stir:
        for (unsigned k = 0; k < op.count && !reference().is_in_flight(); ++k) stir(op, k);
        break;
      case CoreVerb::reach:
        if (twins_.has_reaches()) set_reach(ids, op);
        break;
      case CoreVerb::ask:
        ask(op);
        break;
      case CoreVerb::partners:
        expect_partners();
        break;
      case CoreVerb::exclude:
        twins_.set_exclusions(exclusions_of(op, reference().pairs()));
        break;
      case CoreVerb::begin:
        twins_.begin();
        break;
      case CoreVerb::update:
        update(op.which % 8 == 0);
        break;
      case CoreVerb::shrink:
        if (reference().is_in_flight()) {
          require_error("between begin() and finish()", [&] { subject_.shrink(); });
        } else {
          twins_.shrink();
        }
        break;
      case CoreVerb::save:
        save(op);
        break;
      case CoreVerb::restore:
        restore(op);
        break;
      case CoreVerb::refuse:
        refuse(op);
        break;
      case CoreVerb::enqueue:
      case CoreVerb::change_side:
      case CoreVerb::fail:
        break;
      default:
        if (op.which % 4 == 0 && apply_to_several(ids, op)) break;
        for (unsigned k = 0; k < op.count && k < ids.size(); ++k) {
          apply_to(ids[(op.which + k) % ids.size()], op, k);
        }
    }
    if (subject_.size() != reference().size()) fail("another size");
    if (op.which % 16 == 0) require(twins_.has_same_objects());
  }

  /// Updates that fail, one or two in a row, unless they need nothing of what does.
  void fail_to_update(const CoreOp& op) {
    for (unsigned k = 0; k < 1 + op.which % 2; ++k) {
      try {
        if (op.filter % 3 == 0 || reference().is_in_flight()) {
          update(false);
        } else if (op.filter % 3 == 1 || saved_.empty()) {
          give(op);
        } else {
          restore(op);
        }
      } catch (const Error&) {
        ++failures_;
        if (op.which % 4 < 2) require(same("known", subject_.pairs(), reference().pairs()));
        twins_.note_failure();
      }
    }
  }
  [[nodiscard]] std::size_t failures() const noexcept { return failures_; }

  /// Ends the last update. The lists of earlier ones must be as they were.
  void end() {
    update(false);
    for (const KeptDelta& kept : kept_) require(kept.is_unchanged());
  }

 private:
  [[nodiscard]] const Reference& reference() const { return twins_.reference(); }

  void update(bool keep) {
    const bool was_begun = reference().is_in_flight();
    require(twins_.agree([&](const auto& delta) {
      if constexpr (std::is_same_v<decltype(delta), const Delta&>) {
        if (keep) kept_.emplace_back(delta);
      }
    }));
    if constexpr (requires { subject_.slots(); }) {  // a Core, whose boxes nothing may take for objects
      for (std::uint32_t id = 0; !was_begun && id < subject_.boxes().size(); ++id) {
        if (!reference().contains(id) && !has_nan(subject_.boxes()[id])) fail("a free id has a box");
      }
    }
  }

  void save(const CoreOp& op) {
    if (reference().is_in_flight()) {
      require_error("between begin() and finish()", [&] { (void)subject_.save(); });
    } else if (op.which % 3 == 0 && reference().has_changed()) {
      require_error("no update has reported", [&] { (void)subject_.save(); });
    } else {
      update(false);
      if (saved_.size() == 3) saved_.erase(saved_.begin() + op.which % 3);
      saved_.push_back(twins_.save());
    }
  }

  void restore(const CoreOp& op) {
    if (saved_.empty()) return;
    const auto& saved = saved_[op.which % saved_.size()];
    if (!reference().is_in_flight()) return require(twins_.restore(saved));
    require_error("between begin() and finish()", [&] { (void)restore_to(subject_, saved.first); });
  }

  void add(const Aabb& box, const Filter& filter) {
    if (has_nan(box)) return require_error("NaN", [&] { subject_.add(box, filter); });
    twins_.add(box, filter);
  }

  void add_several(const CoreOp& op) {
    std::vector<Aabb> boxes;
    std::vector<Filter> filters;
    for (unsigned k = 0; k < op.count && reference().size() + boxes.size() < script_.most; ++k) {
      boxes.push_back(box_of(script_, op, k));
      filters.push_back(filter_of(script_, op, k));
    }
    const auto nan = std::ranges::find_if(boxes, has_nan);
    if (nan == boxes.end()) return twins_.add(boxes, filters);
    require_error("box " + std::to_string(nan - boxes.begin()),
                  [&] { subject_.add(BoxView(boxes), filters); });
  }

  /// Moves, removes or filters several at once. The result is whether the operation is one of these.
  bool apply_to_several(const std::vector<std::uint32_t>& ids, const CoreOp& op) {
    if (op.verb == CoreVerb::filter) return set_filters(ids, op);
    if (op.verb != CoreVerb::move && op.verb != CoreVerb::remove) return false;
    std::vector<std::uint32_t> chosen;
    std::vector<Aabb> boxes;
    const unsigned times = op.verb == CoreVerb::move && op.which % 16 == 4 ? 2 : 1;  // in a row
    for (unsigned k = 0; k < op.count && k < ids.size(); ++k) {
      for (unsigned time = 0; time < times; ++time) {
        chosen.push_back(ids[(op.which + k) % ids.size()]);
        boxes.push_back(box_of(script_, op, k + time));
      }
    }
    if (op.verb == CoreVerb::remove) {
      if (chosen.empty()) return true;
      chosen.push_back(chosen.front());
      require_error("twice", [&] { subject_.remove(chosen); });
      chosen.pop_back();
      twins_.remove(chosen);
      return true;
    }
    if (op.which % 8 == 0 && !chosen.empty()) {  // the first one again
      chosen.push_back(chosen.front());
      boxes.push_back(boxes.front());
      std::swap(boxes.front(), boxes[boxes.size() / 2]);
    }
    const auto nan = std::ranges::find_if(boxes, has_nan);
    if (nan != boxes.end()) {
      require_error("box " + std::to_string(nan - boxes.begin()),
                    [&] { subject_.move(chosen, BoxView(boxes)); });
    } else {
      twins_.move(chosen, boxes);
    }
    return true;
  }

  /// An operation on one object that exists.
  void apply_to(std::uint32_t id, const CoreOp& op, unsigned k) {
    if (op.verb == CoreVerb::move) {
      const bool drifts = op.which % 3 == 0;  // which float32 cannot tell of a Warped
      const Aabb box = drifts ? drifted(script_, reference().box(id), drift_of(op)) : box_of(script_, op, k);
      if (has_nan(box)) return require_error("NaN", [&] { subject_.move(id, box); });
      twins_.move(id, box);
    } else if (op.verb == CoreVerb::filter) {
      twins_.set_filter(id, filter_of(script_, op, k));
    } else {
      const Aabb box = reference().box(id);
      const Filter filter = reference().filter(id);
      twins_.remove(id);
      if (op.verb == CoreVerb::replace) add(box, filter);
    }
  }

  /// Of several objects, perhaps the same for all. An id may be given twice.
  bool set_filters(const std::vector<std::uint32_t>& ids, const CoreOp& op) {
    std::vector<std::uint32_t> chosen;
    std::vector<Filter> filters{filter_of(script_, op, 0)};
    for (unsigned k = 0; k < op.count && !ids.empty(); ++k) {
      chosen.push_back(ids[(op.which / 4 + k * (op.which / 8 % 3)) % ids.size()]);
      if (op.which % 3 != 0 && k > 0) filters.push_back(filter_of(script_, op, k));
    }
    twins_.set_filters(chosen, filters);
    return true;
  }

  /// Likewise.
  void set_reach(const std::vector<std::uint32_t>& ids, const CoreOp& op) {
    std::vector<std::uint32_t> chosen;
    std::vector<float> reaches;
    for (unsigned k = 0; k < op.count && !ids.empty(); ++k) {
      chosen.push_back(ids[(op.which + k) % ids.size()]);
      reaches.push_back(reach_of(op, k));
    }
    if (op.which % 4 == 0) reaches.resize(1);
    twins_.set_reach(chosen, reaches);
  }

  /// Writes all boxes or some; at first, one has a NaN.
  void map(const CoreOp& op) {
    const std::size_t n = op.count > 1 ? mapped_of(script_, op) : reference().size();
    if (reference().is_in_flight()) {
      return require_error("between begin() and finish()", [&] { (void)subject_.map(n); });
    }
    twins_.map(n, [&](std::span<Aabb> boxes) {
      for (std::uint32_t k = 0; k < n; k += 1 + op.which % 3) {
        const Aabb box = box_of(script_, op, k);
        if (!has_nan(box)) boxes[k] = box;
      }
    });
    if (n == 0) return;
    const std::uint32_t invalid = op.which % static_cast<std::uint32_t>(n);
    const std::span<Aabb> boxes = subject_.map(n);
    const Aabb before = std::exchange(boxes[invalid], {{nan_value, 0, 0}, {1, 1, 1}});
    require_error("box " + std::to_string(invalid), [&] { subject_.begin(); });
    boxes[invalid] = before;
  }

  /// Gives boxes for all objects, as float32 or float64, also in several frames in which some move; at
  /// first, some or all are those that the objects have, and one has a NaN.
  void give(const CoreOp& op) {
    const std::size_t n = op.count > 1 ? mapped_of(script_, op) : reference().size();
    std::vector<Aabb> boxes(n);
    for (std::uint32_t k = 0; k < n; ++k) {
      const bool keeps = reference().contains(k) && k % (1 + op.filter % 7) != 0;
      const Aabb box = keeps ? reference().box(k) : box_of(script_, op, k);
      boxes[k] = has_nan(box) ? inverted : box;
    }
    std::vector<double> numbers;
    const auto view = [&] {
      numbers.clear();
      for (const Aabb& box : boxes) {
        numbers.insert(numbers.end(), box.lower.begin(), box.lower.end());
        numbers.insert(numbers.end(), box.upper.begin(), box.upper.end());
      }
      return op.which % 3 == 0 ? BoxView::interleaved(numbers.data(), n) : BoxView(boxes);
    };
    if (reference().is_in_flight()) {
      return require_error("between begin() and finish()", [&] { (void)subject_.update(view()); });
    }
    if (n > 0) {
      const std::size_t invalid = op.which % n;
      const Aabb before = std::exchange(boxes[invalid], {{nan_value, 0, 0}, {1, 1, 1}});
      require_error("box " + std::to_string(invalid), [&] { (void)subject_.update(BoxView(boxes)); });
      boxes[invalid] = before;
      require(twins_.has_same_objects());
      if (op.filter % 4 == 0) return;  // no update that might repair what that one broke
    }
    const auto update = [&] { require(twins_.agree(view(), [](const auto& /*delta*/) {})); };
    for (unsigned frame = 0; frame < op.which / 6 % 3; ++frame) {
      update();
      for (std::size_t k = 0; k < n; k += 1 + op.filter % 7)
        boxes[k] = drifted(script_, boxes[k], drift_of(op));
      if (n == 0) continue;
      const Aabb other = box_of(script_, op, frame);
      boxes[op.filter % n] = has_nan(other) ? inverted : other;
    }
    if (op.which % 2 == 0) return twins_.begin(view());
    update();
  }

  /// Moves all boxes by the same small step, or those of even ids, as in the frames of a simulation.
  void drift(const CoreOp& op) {
    twins_.map(reference().slots(),
               [&](std::span<Aabb> boxes) { test::drift(script_, op, boxes, 1 + op.which % 2); });
    update(false);
  }

  void stir(const CoreOp& op, unsigned number) {
    const std::vector<std::uint32_t> ids = reference().ids();
    std::vector<Aabb> before(ids.size());
    std::ranges::transform(ids, before.begin(), [&](std::uint32_t id) { return reference().box(id); });
    std::vector<std::uint32_t> moved;
    std::vector<Aabb> boxes;
    for (std::size_t k = 0; k < ids.size(); ++k) {
      const std::optional<Aabb> box = stirred(script_, op, number, before, k);
      if (!box) continue;
      moved.push_back(ids[k]);
      boxes.push_back(*box);
    }
    twins_.move(moved, boxes);
    update(false);
  }

  void ask(const CoreOp& op) {
    std::vector<Aabb> boxes;
    std::vector<Filter> filters;
    std::vector<std::uint32_t> except;
    for (unsigned k = 0; k < op.which % (op.filter % 4 == 0 ? 150 : 20); ++k) {
      boxes.push_back(box_of(script_, op, k));
      filters.push_back(filter_of(script_, op, k));
      except.push_back((op.which + k) % (script_.most + 1));
    }
    const auto nan = std::ranges::find_if(boxes, has_nan);
    if (nan != boxes.end()) {
      require_error("box " + std::to_string(nan - boxes.begin()),
                    [&] { (void)overlapping_of(subject_, boxes, {}); });
      *nan = inverted;
      boxes.erase(std::remove_if(boxes.begin(), boxes.end(), has_nan), boxes.end());
    }
    QueryOptions options{.count_only = op.filter % 5 == 0};
    if (op.filter % 2 == 0)
      options.filters = std::span(filters).first(op.filter % 4 == 0 ? boxes.size()
                                                                    : std::min<std::size_t>(1, boxes.size()));
    if (op.filter % 3 == 0) options.except = std::span(except).first(boxes.size());
    if (op.filter % 7 == 0) options.limit = 1 + op.filter % 3;
    if (twins_.has_reaches() && op.filter % 5 < 3) options.within = static_cast<double>(op.filter % 7) / 4;
    Objects<Aabb> objects;
    for (const std::uint32_t id : reference().ids())
      objects.set(id, reference().box(id), reference().filter(id), reference().reach(id));
    expect_hits(overlapping_of(subject_, boxes, options), expected_hits<Aabb>(objects, boxes, options));
    if constexpr (requires { subject_.nearest(boxes, options); }) ask_in_order(op, objects, boxes, options);
  }

  /// What is nearest to boxes, and what they meet on their way.
  void ask_in_order(const CoreOp& op, const Objects<Aabb>& objects, std::vector<Aabb> boxes,
                    QueryOptions options) {
    if (options.within == 0.0) options.within.reset();  // which is the same in C
    expect_hits(subject_.nearest(boxes, options),
                expected_ranked_hits<Aabb>(objects, boxes, nullptr, options));
    options.within.reset();
    constexpr std::array components{0.0F, 1.0F, -1.0F, 0.5F, 0.0F, -3.0F, 0x1p-140F};
    constexpr std::array lengths{std::numeric_limits<float>::infinity(), 0.0F, 1.0F, 2.5F, 100.0F};
    Ways<Aabb> ways;
    for (unsigned k = 0; k < boxes.size(); ++k) {
      Aabb& box = boxes[k];
      if (k % 2 == 0 && !is_empty(box)) box.upper = box.lower;
      const auto is_finite = [](float bound) { return std::isfinite(bound); };
      if (!std::ranges::all_of(box.lower, is_finite) || !std::ranges::all_of(box.upper, is_finite))
        box = inverted;
      const std::size_t at = op.which + 11 * k;
      ways.directions.push_back(
          {components.at(at % 7), components.at(at / 7 % 7), components.at(at / 49 % 7)});
      ways.lengths.push_back(lengths.at(at % lengths.size()));
    }
    expect_hits(subject_.along(boxes, ways.directions, ways.lengths, options),
                expected_ranked_hits<Aabb>(objects, boxes, &ways, options));
  }

  static void expect_hits(const Hits& hits, const Hits& expected) {
    if (hits.offsets != expected.offsets || hits.ids != expected.ids ||
        hits.squared_distances != expected.squared_distances || hits.times != expected.times)
      fail("other hits");
  }

  void expect_partners() {
    if (reference().size() == 0) return;
    if (reference().is_in_flight()) {
      return require_error("finish()", [&] { (void)partners_of(subject_, reference().ids().front()); });
    }
    std::vector<std::vector<std::uint32_t>> expected(reference().slots());
    for (const Pair& pair : reference().pairs()) {
      if (pair.a < expected.size()) expected[pair.a].push_back(pair.b);
      if (pair.b < expected.size()) expected[pair.b].push_back(pair.a);
    }
    for (const std::uint32_t id : reference().ids()) {
      std::ranges::sort(expected[id]);
      if (partners_of(subject_, id) != expected[id]) fail("other partners");
    }
  }

  void refuse(const CoreOp& op) {
    std::uint32_t unknown = 0;
    for (const std::uint32_t id : reference().ids()) unknown += id == unknown ? 1U : 0U;
    if (op.which % 2 == 0) unknown += script_.most;
    const auto of_unknown = [&](const auto& function) { require_error("no object has the id", function); };
    of_unknown([&] { subject_.move(unknown, unit); });
    of_unknown([&] { subject_.remove(unknown); });
    of_unknown([&] { subject_.set_filter(unknown, filter_of(script_, op, 0)); });
    const Pairs of_itself{{0, 1}, {op.which, op.which}};
    require_error("and itself", [&] { subject_.set_exclusions(of_itself); });
    if (reference().is_in_flight()) require_error("finish()", [&] { (void)subject_.pairs(); });
  }

  ScopedPart part_;
  Twins<Subject&> twins_;
  Subject& subject_;
  const CoreScript& script_;
  std::vector<KeptDelta> kept_;
  std::vector<decltype(std::declval<Twins<Subject&>&>().save())> saved_;
  std::size_t failures_ = 0;
  bool rounds_ = !is_oclgrind();
};

/// Plays random scripts.
/// @param make Returns a pointer to a new subject.
template <class Make>
void check_core_scripts(const std::string& name, ScriptSize size, std::size_t scripts,
                        std::optional<std::uint64_t> seed, const Make& make) {
  check_scripts(name, scripts, seed, [&] {
    const CoreScript script = *core_scripts(size);
    const auto subject = make();
    CorePlayer player(*subject, script);
    apply_each(script.ops, [&](const CoreOp& op) { player.apply(op); });
    player.end();
  });
}

}  // namespace broadcl::test
