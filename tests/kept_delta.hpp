#pragma once

#include <gtest/gtest.h>

#include <broadcl/pair.hpp>

#include "each_algorithm.hpp"

namespace broadcl::test {

/// A Delta that its user keeps, and its original content.
struct KeptDelta {
  explicit KeptDelta(const Delta& now)
      : delta(now), added(to_vector(now.added)), removed(to_vector(now.removed)) {}
  [[nodiscard]] ::testing::AssertionResult is_unchanged() const { return same(delta, added, removed); }

  Delta delta;
  Pairs added, removed;
};

}  // namespace broadcl::test
