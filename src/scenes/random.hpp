#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <utility>

namespace broadcl::scenes {

/// Random numbers that are the same on every machine. The standard specifies the output of its engines but
/// not that of its distributions, so these are our own.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  /// Uniform in [lower, upper).
  float uniform(float lower, float upper) {
    return lower + (upper - lower) * static_cast<float>(engine_() >> 40) * 0x1p-24F;
  }
  /// Uniform in 0 .. count-1, count > 0.
  std::uint32_t index(std::uint32_t count) {
    return static_cast<std::uint32_t>(((engine_() >> 32) * count) >> 32);
  }
  /// Each component uniform in [lower, upper).
  Eigen::Vector3f vector(float lower, float upper) {
    const float x = uniform(lower, upper);
    const float y = uniform(lower, upper);
    const float z = uniform(lower, upper);
    return {x, y, z};
  }
  /// Shuffles the elements.
  template <class T>
  void shuffle(std::span<T> elements) {
    for (std::size_t k = elements.size(); k > 1; --k) {
      std::swap(elements[k - 1], elements[index(static_cast<std::uint32_t>(k))]);
    }
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace broadcl::scenes
