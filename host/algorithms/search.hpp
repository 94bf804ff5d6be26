#pragma once

#include <cstddef>

#include "opencl/api.hpp"

namespace broadcl {

/// Which slots changed in an update: a word a slot, as kernels/stamp.h has them.
struct Stamps {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  cl::Buffer words;
  cl_uint stamp = 0;         ///< Of this update.
  bool any_renewed = false;  ///< Whether the object of some slot is another one.
};

/// Objects on the device, to be searched for pairs.
struct Search {  // NOLINT(bugprone-exception-escape): as above
  cl_uint slots = 0;
  cl::Buffer boxes;  ///< Six floats a slot; readable, though not used, `Search::padding` slots past the last.
  cl::Buffer filters;  ///< A uint4 a slot, padded alike; not read unless any_filters.
  bool any_filters = false;
  bool worlds = false;  ///< Whether objects are in different worlds.
  bool all = true;      ///< Whether all slots changed; else those in `changed` did.
  cl_uint changed_count = 0;
  cl::Buffer changed;  ///< Slots, each once.
  Stamps stamps;       ///< Which slots changed.

  // As of the last update, which tells what was a pair then.
  cl_uint last_slots = 0;
  cl::Buffer last_boxes;
  cl::Buffer last_filters;
  bool any_last_filters = false;
  bool same_filters = false;  ///< Whether no filter changed since.

  static constexpr std::size_t padding = 16;
};

}  // namespace broadcl
