#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/state.hpp>

#include "base/packed_box.hpp"

namespace broadcl {

using SharedPairs = std::shared_ptr<const std::vector<Pair>>;  // never null

namespace detail {

/// A moment in the life of a Core.
struct Moment {
  std::uint64_t of = 0;  ///< 0 for none; otherwise no two that live in the same process have the same.
  std::uint64_t number = 0;
};

/// The objects of a BroadPhase at some moment.
template <class Box>
struct Saved {
  std::vector<Box> boxes{};               ///< By slot; empty, without a NaN, if no object has it.
  std::vector<std::uint8_t> live{};       ///< By slot: 1 if an object has it, otherwise 0.
  std::vector<Filter> filters{};          ///< By slot, or none if all are the default one.
  std::vector<BoundType<Box>> reaches{};  ///< By slot, or none if all are `first_reach`.
  SharedPairs exclusions{};               ///< In canonical order, each once.
  BoundType<Box> first_reach = 0;         ///< That Config::distance gives to all objects.
  Moment moment{};                        ///< None if it was saved in another process.
};

}  // namespace detail

using detail::Moment;
using detail::Saved;

}  // namespace broadcl
