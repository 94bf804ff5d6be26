#pragma once

#include <string>

#include <broadcl/config.hpp>
#include <broadcl/error.hpp>

#include "base/distance.hpp"
#include "base/floating_point.hpp"

namespace broadcl {

/// @param what The error begins with this and the number.
/// @throws Error for a reach that is negative, NaN or too great.
template <class Bound>
void refuse_invalid_reach(Bound reach, const char* what = "a reach of ") {
  if (reach >= 0 && reach <= most_reach<Bound>) return;
  throw Error::invalid_argument(what + std::to_string(reach) + "; give one from 0 to 2^62");
}

template <class Bound>
[[nodiscard, gnu::noinline]] Bound rounded_to(double number) noexcept {
  return static_cast<Bound>(number);
}

/// The reach of all objects that a distance stands for.
/// @throws Error for a distance that is negative, NaN or too great.
template <class Bound>
[[nodiscard]] Bound reach_for(const Config& config) {
  if (!(config.distance >= 0 && config.distance <= 2 * most_reach<double>)) {
    throw Error::invalid_argument("a distance of " + std::to_string(config.distance) +
                                  "; give one from 0 to 2^63");
  }
  const DefaultFloatingPoint as_everywhere;
  return rounded_to<Bound>(config.distance) / 2;
}

}  // namespace broadcl
