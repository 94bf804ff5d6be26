#include "c/call.hpp"

#include <gtest/gtest.h>

namespace broadcl::test {
namespace {

/// No call of the C interface fails in each of these ways on every device, so this sees the library from
/// inside.
TEST(CStatus, IsThatOfTheKindOfError) {
  const auto status_of = [](ErrorKind kind) { return c::call("f", [&] { throw Error("text", kind); }); };
  EXPECT_EQ(status_of(ErrorKind::invalid_argument), BROADCL_INVALID_ARGUMENT);
  EXPECT_EQ(status_of(ErrorKind::out_of_device_memory), BROADCL_OUT_OF_DEVICE_MEMORY);
  EXPECT_EQ(status_of(ErrorKind::device_lost), BROADCL_DEVICE_LOST);
  EXPECT_EQ(status_of(ErrorKind::other), BROADCL_FAILED);
}

}  // namespace
}  // namespace broadcl::test
