#include <broadcl/aabb.hpp>

#include <cmath>

namespace broadcl {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

float round_down(double value) {
  const auto nearest = static_cast<float>(value);
  return double{nearest} > value ? std::nextafter(nearest, -infinity) : nearest;
}

float round_up(double value) {
  return -round_down(-value);
}

}  // namespace

Aabb round_outward(const std::array<double, 3>& lower, const std::array<double, 3>& upper) noexcept {
  return {{round_down(lower[0]), round_down(lower[1]), round_down(lower[2])},
          {round_up(upper[0]), round_up(upper[1]), round_up(upper[2])}};
}

}  // namespace broadcl
