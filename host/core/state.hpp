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

/// The objects of a BroadPhase at some moment.
template <class Box>
struct Saved {
  std::vector<Box> boxes{};               ///< By slot; empty, without a NaN, if no object has it.
  std::vector<std::uint8_t> live{};       ///< By slot: 1 if an object has it, otherwise 0.
  std::vector<Filter> filters{};          ///< By slot, or none if all are the default one.
  std::vector<BoundType<Box>> reaches{};  ///< By slot, or none if all are `first_reach`.
  SharedPairs exclusions{};               ///< In canonical order, each once.
  BoundType<Box> first_reach = 0;         ///< That Config::distance gives to all objects.
};

}  // namespace detail

using detail::Saved;

}  // namespace broadcl
