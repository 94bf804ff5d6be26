#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>

#include "base/box_parts.hpp"
#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/threads.hpp"
#include "core/change_set.hpp"

namespace broadcl {

/// The reach of the image of a box by a map that keeps distances: such that images are within the sum of
/// their reaches if the boxes are.
[[nodiscard, gnu::noinline]] inline float reach_of_image(const Aabb& image, double reach) noexcept {
  constexpr double more = 1 + 0x1p-20;  // than all rounding in float32 together
  float largest = 0;
  for (const auto& corner : {image.lower, image.upper}) {
    for (const float bound : corner) {
      if (std::isfinite(bound)) largest = std::max(largest, std::abs(bound));
    }
  }
  return static_cast<float>((reach + static_cast<double>(image_error(largest))) * more);
}

/// The reaches of objects as of an update in double precision, and those of their images, by slot; none if no
/// object ever had a reach.
class ExactReaches {
 public:
  /// @param threads At most; 0 for one per processor.
  explicit ExactReaches(Threads threads) noexcept : threads_(std::move(threads)) {}

  /// To be called when the images have been made.
  /// @param changes The slots whose box, image or reach is not that of the last call.
  /// @throws std::bad_alloc; all slots must count as changed then.
  void update(std::span<const double> reaches, std::span<const Aabb> images, const ChangeSet& changes) {
    if (reaches.empty()) return;
    exact_.resize(reaches.size());
    of_images_.resize(reaches.size());
    const auto set = [&](std::size_t slot) {
      exact_[slot] = reaches[slot];
      of_images_[slot] = reach_of_image(images[slot], reaches[slot]);
    };
    const DefaultFloatingPoint as_everywhere;
    if (!changes.all) {
      for (const std::uint32_t slot : changes.changed()) set(slot);
      return;
    }
    for_each_part(reaches.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
      const DefaultFloatingPoint also_here;
      for (std::size_t slot = begin; slot < end; ++slot) set(slot);
    });
  }

  [[nodiscard]] std::span<const double> exact() const noexcept { return exact_; }
  [[nodiscard]] std::span<const float> of_images() const noexcept { return of_images_; }

  /// Frees memory that these slots do not need.
  void shrink(std::size_t slots) {
    exact_.resize(std::min(exact_.size(), slots));
    exact_.shrink_to_fit();
    of_images_.resize(exact_.size());
    of_images_.shrink_to_fit();
  }

 private:
  Threads threads_;
  std::vector<double> exact_;
  std::vector<float> of_images_;
};

}  // namespace broadcl
