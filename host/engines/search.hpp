#pragma once

#include <cstddef>

#include "opencl/api.hpp"

namespace broadcl {

/// Objects on the device as of one frame.
struct Generation {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  cl_uint slots = 0;
  cl::Buffer boxes{};       ///< Six floats per slot; `padding` more slots can be read, but are not used.
  cl::Buffer filters{};     ///< One uint4 per slot, padded likewise; null if all have the default filter.
  cl::Buffer exclusions{};  ///< In the format of kernels/filter.h; null if there are none.
  /// If not null, boxes are grown by the reaches of their objects, and these are the boxes as they were, and
  /// the reaches: one float8 per slot, as kernels/distance.h has it.
  cl::Buffer ungrown{};
  /// If not 0, the first slot of the second of two sets, whose objects are reported by their indices in that
  /// set.
  cl_uint second_set = 0;

  static constexpr std::size_t padding = 16;
};

class Source;

/// Which slots changed since the last frame.
struct ChangedSlots {  // NOLINT(bugprone-exception-escape): as above
  bool all = true;     ///< Every slot counts as changed; otherwise those in `slots` do.
  cl_uint count = 0;
  cl::Buffer slots{};    ///< Each once.
  cl_uint recycled = 0;  ///< Slots whose object is another one than in the last frame.
  cl_uint stamp = 0;     ///< Of this frame.
  /// One word per slot that says whether it changed (unless `all`), and whether its object is not that of the
  /// last frame: kernels/stamp.h. Null if neither applies to any slot.
  cl::Buffer stamps{};
};

/// Objects on the device, to be searched for pairs. The pairs of the last frame follow from `last`.
struct Search {  // NOLINT(bugprone-exception-escape): as above
  Generation now;
  Generation last{};
  ChangedSlots changed{};
  /// Where PairFinder::build() has to gather `now` from; null if `now` is up to date.
  const Source* source = nullptr;
  /// Whether no exclusion changed since the last frame, and no filter of an object that existed then.
  bool same_filters = false;
  bool worlds = false;  ///< Whether objects are in different worlds.
  bool sets = false;    ///< Whether filters part the objects into two sets: TwoSets.
  /// If not 0, changes are sorted by world first, and this is the number of worlds.
  cl_uint ordered_worlds = 0;
  bool may_give_up = true;  ///< Whether the host waits for the search, and repeats it if it was given up.

  [[nodiscard]] cl_uint changed_slots() const noexcept { return changed.all ? now.slots : changed.count; }
};

}  // namespace broadcl
