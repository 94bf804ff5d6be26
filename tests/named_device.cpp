#include <cstdlib>

#include <gtest/gtest.h>

#include <broadcl/device.hpp>

#include "environment.hpp"

namespace broadcl::test {
namespace {

/// Names a device for the tests, so that `auto` uses it. Otherwise it would work on the host if the device is
/// a CPU.
class NamedDevice : public ::testing::Environment {
 public:
  void SetUp() override {
    const char* variable = std::getenv("BROADCL_DEVICE");
    if (variable != nullptr && *variable != '\0') return;
    if (!devices().empty()) set_variable("BROADCL_DEVICE", select_device().id().c_str());
  }
};
const ::testing::Environment* const named_device = ::testing::AddGlobalTestEnvironment(new NamedDevice);

}  // namespace
}  // namespace broadcl::test
