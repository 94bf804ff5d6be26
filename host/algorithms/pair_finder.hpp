#pragma once

#include "algorithms/pair_delta.hpp"
#include "opencl/context.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {

/// Objects on the device, to be searched for pairs.
struct Search {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  cl_uint slots = 0;
  cl::Buffer boxes;  ///< Six floats a slot; readable, though not used, `Search::padding` slots past the last.
  cl::Buffer filters;  ///< A uint4 a slot, padded alike; not read unless any_filters.
  bool any_filters = false;
  bool worlds = false;  ///< Whether objects are in different worlds.
  bool all = true;      ///< Whether all slots changed; else those in `changed` did.
  cl_uint changed_count = 0;
  cl::Buffer changed;  ///< Slots, each once.
  Stamps stamps;       ///< Which slots changed.

  static constexpr std::size_t padding = 16;
};

/// The part of an algorithm that finds pairs on the device.
class PairFinder {
 public:
  PairFinder() = default;
  virtual ~PairFinder() = default;
  PairFinder(const PairFinder&) = delete;
  PairFinder& operator=(const PairFinder&) = delete;
  PairFinder(PairFinder&&) = delete;
  PairFinder& operator=(PairFinder&&) = delete;

  /// Enqueues what puts every pair of which an object changed to the sink, each once. May be called again for
  /// the same search, where the sink was too small.
  /// @throws cl::Error, Error
  virtual void find(const Search& search, const PairDelta& sink, opencl::Profiler& profiler) = 0;
};

}  // namespace broadcl
