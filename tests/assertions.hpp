#pragma once

#include <atomic>

#include <gtest/gtest.h>

namespace broadcl::test {

/// Assertions that tests have evaluated. A test that ends without one proves nothing, and fails (main.cpp).
inline std::atomic<unsigned long> assertions = 0;

/// @returns 0.
inline int count_assertion() noexcept {
  ++assertions;
  return 0;
}

}  // namespace broadcl::test

// Each EXPECT_ and each ASSERT_ begins with this; gtest's own is a switch (0).
#ifndef GTEST_AMBIGUOUS_ELSE_BLOCKER_
#error "this GoogleTest's assertions begin in another way; count them as they do"
#endif
#undef GTEST_AMBIGUOUS_ELSE_BLOCKER_
#define GTEST_AMBIGUOUS_ELSE_BLOCKER_         \
  switch (::broadcl::test::count_assertion()) \
  case 0:                                     \
  default:
