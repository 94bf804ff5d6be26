#pragma once

#include <memory>
#include <utility>

#include <gtest/gtest.h>

#include <broadcl/pair.hpp>

#include "each_algorithm.hpp"

namespace broadcl::test {

/// A Delta that its user keeps, and its original content.
struct KeptDelta {
  KeptDelta(const Delta& now, std::shared_ptr<const void> owner)
      : delta(now), added(to_vector(now.added)), removed(to_vector(now.removed)), memory(std::move(owner)) {}
  [[nodiscard]] ::testing::AssertionResult is_unchanged() const { return same(delta, added, removed); }

  Delta delta;
  Pairs added, removed;
  std::shared_ptr<const void> memory;
};

}  // namespace broadcl::test
