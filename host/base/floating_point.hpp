#pragma once

#include <cfenv>

namespace broadcl {

/// While it exists, the calling thread rounds to the nearest number, has denormal numbers, and no operation
/// traps, whatever its owner has set; then everything is as before. So all threads compute the same.
///
/// Operations must stand in functions that are not inlined, or a compiler may move them out of its life.
class DefaultFloatingPoint {
 public:
  DefaultFloatingPoint() noexcept {
    std::fegetenv(&callers_);
    std::fesetenv(FE_DFL_ENV);
  }
  ~DefaultFloatingPoint() { std::fesetenv(&callers_); }
  DefaultFloatingPoint(const DefaultFloatingPoint&) = delete;
  DefaultFloatingPoint& operator=(const DefaultFloatingPoint&) = delete;
  DefaultFloatingPoint(DefaultFloatingPoint&&) = delete;
  DefaultFloatingPoint& operator=(DefaultFloatingPoint&&) = delete;

 private:
  std::fenv_t callers_{};
};

}  // namespace broadcl
