#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>

#include "base/system.hpp"
#include "boxes.hpp"
#include "environment.hpp"
#include "expect_error.hpp"
#include "forked_child.hpp"

/// A program of its own, since the tests of the others load drivers.
namespace broadcl::test {
namespace {

using ::testing::HasSubstr;

/// So slowly that `auto` looks for a GPU, if it may.
void update_slowly() {
  BroadPhase broad_phase;
  std::vector<Aabb> boxes(20'000, unit);
  for (std::uint32_t turn = 0; turn < 50; ++turn) {
    for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = apart(k + turn);
    (void)broad_phase.update(boxes);
  }
}

TEST(AutoWithoutAGpu, IsThatWithoutDeviceFilesOfOne) {
#ifdef __linux__
  for (const char* name : {"dri/renderD128", "nvidia0", "kfd", "dxg", "mali0", "kgsl-3d0", "pvr_sync"}) {
    const ScopedFolder folder;
    std::filesystem::create_directory(folder.path() / "dri");
    const auto make = [&](const char* file) { const std::ofstream made(folder.path() / file); };
    for (const char* other : {"null", "dri/card0"}) make(other);
    EXPECT_FALSE(may_have_gpu(folder.path()));
    make(name);
    EXPECT_TRUE(may_have_gpu(folder.path())) << name;
  }
  EXPECT_TRUE(may_have_gpu("/no such folder"));
#else
  EXPECT_TRUE(may_have_gpu());
#endif
}

TEST(AutoWithoutAGpu, LoadsNoDriverSoAForkedChildMayUseDevices) {
  const auto libraries = [] {
    std::set<std::string> names;
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);) {
      if (line.find(".so") != std::string::npos) names.insert(line.substr(line.find('/')));
    }
    return names;
  };
  if (may_have_gpu()) GTEST_SKIP() << "there may be a GPU";
  const ScopedVariable unnamed("BROADCL_DEVICE", "");
  const std::set<std::string> before = libraries();
  update_slowly();
  EXPECT_EQ(libraries(), before);
  EXPECT_TRUE(holds_in_child([] { EXPECT_FALSE(devices().empty()); }));
  EXPECT_FALSE(devices().empty());
  EXPECT_NE(libraries(), before);
  EXPECT_TRUE(holds_in_child(
      [] { EXPECT_THAT(error_of([] { (void)devices(); }), HasSubstr("by `auto`, to look for a GPU")); }));
}

}  // namespace
}  // namespace broadcl::test
