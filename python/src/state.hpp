#pragma once

#include <variant>

#include <broadcl/state.hpp>

namespace broadcl::python {

/// What BroadPhase.save() returns in Python: the state of a BroadPhase or of a BroadPhase64.
struct SavedObjects {
  std::variant<State, State64> state;
};

}  // namespace broadcl::python
