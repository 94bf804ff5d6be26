#pragma once

#include <LinearMath/btVector3.h>

#include <cstddef>
#include <ostream>
#include <vector>

#include <rapidcheck.h>

#include "random_boxes.hpp"

namespace broadcl::test {

/// The corners of a box, which are all that Bullet knows of it.
struct Corners {
  btVector3 lower;
  btVector3 upper;
};

[[nodiscard]] Corners corners(const BoxSpec& spec);

enum class Verb {
  create,
  destroy,
  recreate,  ///< Destroy and create, with the same box and another filter; this refreshes a proxy.
  move,
  set_again,    ///< setAabb with the current box.
  filter,       ///< Group and mask written in place.
  callback,     ///< Another overlap filter callback, or none.
  remove_pair,  ///< From the cache, bypassing the broad phase, as do the next three.
  remove_pairs_of,
  clean_pairs_of,  ///< Their algorithms end; the pairs stay.
  add_again,       ///< A cached pair; a sorted cache then has it twice.
  begin,
  step,
  rays,
  box_queries,
  reset,  ///< resetPool(), while proxies exist.
  clear   ///< All proxies are destroyed, then the pool is reset.
};

/// One call, or a few of the same kind.
struct Op {
  Verb verb = Verb::step;
  unsigned which = 0;  ///< The object of the verb: a live proxy, a pair, a callback, modulo their number.
  unsigned count = 1;  ///< This many proxies or queries, one after the other.
  BoxSpec box{};
  int group = 1;
  int mask = -1;

  friend bool operator==(const Op&, const Op&) = default;
};

enum class CacheKind { own, hashed, users_class, sorted, null };

/// The life of a broad phase. It stays valid whatever is left out of it.
struct Script {
  CacheKind cache = CacheKind::own;
  std::vector<Op> ops;
};

std::ostream& operator<<(std::ostream& out, const Op& op);
std::ostream& operator<<(std::ostream& out, const Script& script);

/// The largest number of proxies that exist at once in any script.
constexpr std::size_t most_proxies = 500;

/// Scripts with this many operations, each script with its own density of boxes, number of proxies, cache and
/// share of odd boxes. They shrink by leaving out operations and by making others simpler.
[[nodiscard]] rc::Gen<Script> scripts(std::size_t length);

}  // namespace broadcl::test
