#pragma once

#include <cstdint>
#include <optional>
#include <ostream>
#include <span>
#include <vector>

#include <rapidcheck.h>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "each_algorithm.hpp"
#include "random_boxes.hpp"

/// Scripts of calls for a BroadPhase or a DeviceBroadPhase. Either leaves out what it does not have.
namespace broadcl::test {

enum class CoreVerb {
  add,
  remove,
  replace,  ///< Remove and add with the same box, so that the id belongs to another object.
  move,
  map,   ///< Of another number of objects, unless `count` is 1; of a DeviceBroadPhase also in another layout.
  give,  ///< An update, or its begin, with boxes of the caller's for all objects, of the same number or
         ///< another.
  drift,  ///< A few updates in which boxes move a little.
  stir,   ///< A few updates in which some objects leap, or all change places.
  filter,
  reach,
  ask,       ///< Queries with boxes, in several ways.
  partners,  ///< Of all objects.
  exclude,
  begin,
  update,       ///< Or finish(), if an update was begun.
  enqueue,      ///< An update of a DeviceBroadPhase that nobody waits for.
  change_side,  ///< Of `auto`, between host and device.
  fail,         ///< An update or two that fail when all but the comparison in double precision is done.
  shrink,
  save,     ///< After an update.
  restore,  ///< One of the last states that were saved.
  refuse    ///< Calls with errors, which must change nothing.
};

/// Which filters a script uses. Of `levels`, most objects refuse each other, as Bullet's static ones do.
enum class FilterKind { none, levels, groups, worlds, sets, sets_of_worlds, all };

/// One call, or a few of the same kind.
struct CoreOp {
  CoreVerb verb = CoreVerb::update;
  unsigned which = 0;  ///< The object of the verb, modulo their number, or a variant of it.
  unsigned count = 1;  ///< This many objects, one after the other.
  BoxSpec box{};
  unsigned filter = 0;  ///< See filter_of().

  friend bool operator==(const CoreOp&, const CoreOp&) = default;
};

/// The life of a broad phase. It stays valid whatever is left out of it.
struct CoreScript {
  std::uint32_t most = 0;  ///< Objects at once, at most.
  int extent = 1;          ///< Of the corners of boxes, in halves: the smaller, the more pairs.
  FilterKind filters = FilterKind::none;
  unsigned warp = 0;     ///< In double precision: which Warp.
  bool is_flat = false;  ///< All boxes are in the plane z = 0.
  unsigned part = 2048;  ///< boxes_per_part of the host's loops.
  std::vector<CoreOp> ops;
};

/// A filter of a kind, by any number.
[[nodiscard]] Filter filter_of(FilterKind kind, unsigned number);

/// Box k < count of an operation, and its filter.
[[nodiscard]] Aabb box_of(const CoreScript& script, const CoreOp& op, unsigned k);
[[nodiscard]] Filter filter_of(const CoreScript& script, const CoreOp& op, unsigned k);

/// The reach of object k of an operation.
[[nodiscard]] float reach_of(const CoreOp& op, unsigned k);

/// The number of objects after a map() of another number.
[[nodiscard]] std::size_t mapped_of(const CoreScript& script, const CoreOp& op);

/// Box k of an update of a stir, k < number of objects.
/// @param boxes Of all objects, before the update.
[[nodiscard]] std::optional<Aabb> stirred(const CoreScript& script, const CoreOp& op, unsigned update,
                                          std::span<const Aabb> boxes, std::size_t k);

/// Pairs to exclude: of those given, none or one in a few, in any order; some twice, and some that do not
/// overlap or do not exist.
[[nodiscard]] Pairs exclusions_of(const CoreOp& op, const Pairs& present);

/// By how much boxes drift, and such a box afterwards.
[[nodiscard]] float drift_of(const CoreOp& op);
[[nodiscard]] Aabb drifted(const CoreScript& script, Aabb box, float step);
/// Lets each `stride`-th box drift, and perhaps one become empty or come back.
void drift(const CoreScript& script, const CoreOp& op, std::span<Aabb> boxes, std::size_t stride);

std::ostream& operator<<(std::ostream& out, const CoreOp& op);
std::ostream& operator<<(std::ostream& out, const CoreScript& script);

enum class ScriptSize {
  tiny,   ///< For devices that take seconds per update.
  small,  ///< Up to 60 objects, sometimes 250 or 600, rarely more than 2,000 in a few updates.
};

/// Scripts, each with its own density, number of objects, filters and share of odd boxes.
[[nodiscard]] rc::Gen<CoreScript> core_scripts(ScriptSize size);

}  // namespace broadcl::test
