#include "base/control_groups.hpp"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <limits>
#include <sstream>
#include <string_view>
#include <vector>

namespace broadcl {
namespace {

constexpr std::size_t no_limit = std::numeric_limits<std::size_t>::max();

/// None if there is no such file.
std::vector<std::string> lines_of(const std::string& file) {
  std::ifstream in(file);
  in.exceptions(std::ios::badbit);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream in(line);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

bool has_cpu(std::string_view controllers) {
  return ("," + std::string(controllers) + ",").find(",cpu,") != std::string::npos;
}

/// @param group Its folder.
std::size_t limit_of(const std::string& group) {
  std::string numbers;  // microseconds, and of how many
  for (const char* file : {"/cpu.max", "/cpu.cfs_quota_us", "/cpu.cfs_period_us"}) {
    for (const std::string& line : lines_of(group + file)) numbers += line + ' ';
  }
  std::istringstream in(numbers);
  std::int64_t quota = 0;
  std::int64_t period = 0;
  const bool is_limited = in >> quota >> period && quota > 0 && period > 0;  // otherwise `max` or -1
  return is_limited ? static_cast<std::size_t>((quota - 1) / period + 1) : no_limit;
}

}  // namespace

std::size_t control_group_processors(const std::string& root) {
  std::size_t least = no_limit;
  const std::vector<std::string> groups = lines_of(root + "/proc/self/cgroup");
  for (const std::string& line : lines_of(root + "/proc/self/mountinfo")) {
    const std::vector<std::string> mount = words_of(line);
    const auto dash = std::ranges::find(mount, "-");
    if (dash - mount.begin() < 6 || mount.end() - dash < 4) continue;
    const bool is_second = dash[1] == "cgroup2";
    if (!is_second && (dash[1] != "cgroup" || !has_cpu(dash[3]))) continue;
    const std::string folder = root + mount[4];
    const std::string top = mount[3] == "/" ? "" : mount[3];  // the group whose folder that is
    for (const std::string& group : groups) {                 // NUMBER:CONTROLLERS:PATH
      const std::size_t first = group.find(':');
      const std::size_t second = group.find(':', first + 1);
      if (first == std::string::npos || second == std::string::npos) continue;
      const std::string_view controllers = std::string_view(group).substr(first + 1, second - first - 1);
      if (is_second ? !controllers.empty() : !has_cpu(controllers)) continue;
      std::string path = group.substr(second + 1);
      if (!(path + "/").starts_with(top + "/")) path = top;  // outside of what this process sees
      for (path.erase(0, top.size()); path.starts_with('/'); path.resize(path.rfind('/')))
        least = std::min(least, limit_of(folder + path));
    }
    least = std::min(least, limit_of(folder));
  }
  return least;
}

}  // namespace broadcl
