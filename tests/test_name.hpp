#pragma once

#include <algorithm>
#include <string>
#include <string_view>

namespace broadcl::test {

/// A name as gtest allows it in names of tests: without hyphens and plus signs.
inline std::string test_name(std::string_view name) {
  std::string result(name);
  std::ranges::replace_if(
      result, [](char c) { return c == '-' || c == '+'; }, '_');
  return result;
}

/// Names tests after their parameter, a name or something that has one.
inline constexpr auto named_by_parameter = [](const auto& test) {
  if constexpr (requires { test.param.name; }) {
    return test_name(test.param.name);
  } else {
    return test_name(test.param);
  }
};

}  // namespace broadcl::test
