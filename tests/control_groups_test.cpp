#include "base/control_groups.hpp"

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "environment.hpp"

namespace broadcl::test {
namespace {

/// Files as the kernel writes them.
class ControlGroups : public ::testing::Test {
 protected:
  void write(const std::string& file, const std::string& text) const {
    const std::filesystem::path path = folder_.path().string() + file;
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << text << '\n';
  }
  /// @param group What /proc/self/cgroup says, @param mount and where groups are mounted.
  void write(const std::string& group, const std::string& top, const std::string& mount) const {
    write("/proc/self/cgroup", "5:memory:/elsewhere\n" + group);
    write("/proc/self/mountinfo",
          "22 1 0:20 / /proc rw shared:1 - proc proc rw\n30 23 0:26 " + top + " /sys/fs/" + mount);
  }
  [[nodiscard]] std::size_t processors() const { return control_group_processors(folder_.path().string()); }

  static constexpr std::size_t no_limit = std::numeric_limits<std::size_t>::max();

 private:
  ScopedFolder folder_;
};

TEST_F(ControlGroups, SetNoLimitIfThereAreNone) {
  EXPECT_EQ(processors(), no_limit);
  write("0::/", "/", "cgroup rw shared:9 master:2 - cgroup2 cgroup2 rw");
  EXPECT_EQ(processors(), no_limit);
  EXPECT_GE(control_group_processors(), 1U);
}

TEST_F(ControlGroups, OfTheSecondVersionLimitWhatIsBelow) {
  write("0::/a/b:c/d", "/", "cgroup rw - cgroup2 cgroup2 rw,nsdelegate");
  write("/sys/fs/cgroup/a/b:c/d/cpu.max", "max 100000");
  EXPECT_EQ(processors(), no_limit);
  write("/sys/fs/cgroup/a/b:c/cpu.max", "800000 100000");
  EXPECT_EQ(processors(), 8U);
  write("/sys/fs/cgroup/a/cpu.max", "250000 100000");
  EXPECT_EQ(processors(), 3U);
  write("/sys/fs/cgroup/a/b:c/d/cpu.max", "1000 100000");
  EXPECT_EQ(processors(), 1U);
  write("/sys/fs/cgroup/a/b:c/d/cpu.max", "300000 100000");
  EXPECT_EQ(processors(), 3U);
}

TEST_F(ControlGroups, OfTheFirstVersionLimitWhatIsBelow) {
  write("4:cpuset:/x\n3:cpu,cpuacct:/a/b", "/", "cgroup/cpu rw - cgroup cgroup rw,cpu,cpuacct");
  write("/sys/fs/cgroup/cpu/x/cpu.cfs_quota_us", "100000");
  write("/sys/fs/cgroup/cpu/x/cpu.cfs_period_us", "100000");
  write("/sys/fs/cgroup/cpu/a/b/cpu.cfs_quota_us", "-1");
  write("/sys/fs/cgroup/cpu/a/b/cpu.cfs_period_us", "100000");
  EXPECT_EQ(processors(), no_limit);
  write("/sys/fs/cgroup/cpu/a/cpu.cfs_quota_us", "100000");
  EXPECT_EQ(processors(), no_limit);
  write("/sys/fs/cgroup/cpu/a/cpu.cfs_period_us", "50000");
  EXPECT_EQ(processors(), 2U);
}

TEST_F(ControlGroups, OfOtherControllersDoNotCount) {
  write("3:cpuset:/a", "/", "cgroup/cpuset rw - cgroup cgroup rw,cpuset");
  write("/sys/fs/cgroup/cpuset/a/cpu.max", "100000 100000");
  EXPECT_EQ(processors(), no_limit);
}

TEST_F(ControlGroups, OfAContainerAreBelowTheirMount) {
  write("/sys/fs/cgroup/cpu.max", "400000 100000");
  write("/sys/fs/cgroup/inner/cpu.max", "200000 100000");
  for (const std::string group :
       {"0::/docker/box/inner", "0::/docker/box", "0::/docker/boxes/inner", "0::/../x"}) {
    write(group, "/docker/box", "cgroup rw - cgroup2 cgroup2 rw");
    EXPECT_EQ(processors(), group == "0::/docker/box/inner" ? 2U : 4U) << group;
  }
}

}  // namespace
}  // namespace broadcl::test
