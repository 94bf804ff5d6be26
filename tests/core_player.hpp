#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>

#include "boxes.hpp"
#include "core_random_script.hpp"
#include "each_algorithm.hpp"
#include "kept_delta.hpp"
#include "random_scripts.hpp"
#include "rounding.hpp"
#include "twins.hpp"

namespace broadcl::test {

/// Plays a script to a subject of Twins, in a rounding mode that depends on the operation.
template <class Subject>
class CorePlayer {
 public:
  CorePlayer(Subject& subject, const CoreScript& script)
      : twins_(std::in_place, NoTrouble(), false, subject), subject_(subject), script_(script) {}

  void apply(const CoreOp& op) {
    const ScopedRounding rounding(rounding_modes.at(rounds_ ? op.which % rounding_modes.size() : 0));
    const std::vector<std::uint32_t> ids = reference().ids();
    switch (op.verb) {
      case CoreVerb::add:
        for (unsigned k = 0; k < op.count && reference().size() < script_.most; ++k) {
          add(box_of(script_, op, k), filter_of(script_, op, k));
        }
        break;
      case CoreVerb::map:
        map(op);
        break;
      case CoreVerb::drift:
        for (unsigned k = 0; k < op.count && !reference().is_in_flight(); ++k) drift(op);
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
      case CoreVerb::refuse:
        refuse(op);
        break;
      case CoreVerb::enqueue:
      case CoreVerb::change_side:
        break;
      default:
        for (unsigned k = 0; k < op.count && k < ids.size(); ++k) {
          apply_to(ids[(op.which + k) % ids.size()], op, k);
        }
    }
    if (subject_.size() != reference().size()) fail("another size");
  }

  /// Ends the last update. The lists of earlier ones must be as they were.
  void end() {
    update(false);
    for (const KeptDelta& kept : kept_) require(kept.is_unchanged());
  }

 private:
  [[nodiscard]] const Reference& reference() const { return twins_.reference(); }

  void update(bool keep) {
    require(twins_.agree([&](const auto& delta) {
      if constexpr (std::is_same_v<decltype(delta), const Delta&>) {
        if (keep) kept_.emplace_back(delta);
      }
    }));
  }

  void add(const Aabb& box, const Filter& filter) {
    if (has_nan(box)) return require_error("NaN", [&] { subject_.add(box, filter); });
    twins_.add(box, filter);
  }

  /// An operation on one object that exists.
  void apply_to(std::uint32_t id, const CoreOp& op, unsigned k) {
    if (op.verb == CoreVerb::move) {
      const Aabb box = box_of(script_, op, k);
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

  /// Moves all boxes by the same small step, or those of even ids, as in the frames of a simulation.
  void drift(const CoreOp& op) {
    const float step = drift_of(op);
    twins_.map(reference().slots(), [&](std::span<Aabb> boxes) {
      for (std::size_t k = 0; k < boxes.size(); k += 1 + op.which % 2) boxes[k] = drifted(boxes[k], step);
    });
    update(false);
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

  Twins<Subject&> twins_;
  Subject& subject_;
  const CoreScript& script_;
  std::vector<KeptDelta> kept_;
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
