#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <memory>
#include <utility>

#include <broadcl/aabb.hpp>

namespace broadcl {

template <class Box>
class BasicBroadPhase;
template <class Box>
struct Saved;

/// What BasicBroadPhase::save() returns: ids, boxes, filters, reaches and exclusions of all objects, as they
/// were then. Cheap to copy, since copies share what they have. It takes 25 bytes for each id up to the
/// highest (49 in double precision), 16 more with filters, 4 (8) with reaches; exclusions are shared with
/// the broad phase.
///
/// Any number of threads may use a state and its copies at the same time.
/// @tparam Box That of the BasicBroadPhase.
template <class Box>
class BasicState {
 private:
  friend class BasicBroadPhase<Box>;
  explicit BasicState(std::shared_ptr<const Saved<Box>> saved) noexcept : saved_(std::move(saved)) {}

  std::shared_ptr<const Saved<Box>> saved_;
};

/// The state of a BroadPhase.
using State = BasicState<Aabb>;
/// The state of a BroadPhase64.
using State64 = BasicState<Aabb64>;

}  // namespace broadcl

#endif
