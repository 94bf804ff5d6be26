#pragma once

#include <algorithm>
#include <cstddef>

namespace broadcl {

/// The pause after something that did not pay, in frames, until it is tried again: each is twice as long as
/// the one before, and half as long after a try that paid.
class BackOff {
 public:
  /// @param longest Frames.
  explicit BackOff(std::size_t longest) : longest_(longest) {}

  /// @param frame A number that increases by one with each frame; likewise below.
  [[nodiscard]] bool is_over(std::size_t frame) const noexcept { return frame >= end_; }
  void shorten() noexcept { frames_ /= 2; }
  void start(std::size_t frame) noexcept {
    frames_ = std::min(2 * frames_ + 1, longest_);
    end_ = frame + 1 + frames_;
  }

 private:
  std::size_t longest_;
  std::size_t frames_ = 0;
  std::size_t end_ = 0;
};

}  // namespace broadcl
