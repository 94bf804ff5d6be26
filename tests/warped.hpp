#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

namespace broadcl::test {

/// Another number in the same order as those of others, in double precision: of all numbers between two
/// powers of two, single precision can tell none apart.
[[nodiscard]] inline double warped(float number) noexcept {
  const auto exact = static_cast<double>(number);
  if (!std::isfinite(exact)) return exact;
  constexpr std::uint64_t fraction = (std::uint64_t{1} << 52U) - 1;
  const auto bits = std::bit_cast<std::uint64_t>(exact);
  return std::bit_cast<double>((bits & ~fraction) | (bits & fraction) >> 25U);
}

[[nodiscard]] inline float unwarped(double number) noexcept {
  if (!std::isfinite(number)) return static_cast<float>(number);
  constexpr std::uint64_t fraction = (std::uint64_t{1} << 52U) - 1;
  const auto bits = std::bit_cast<std::uint64_t>(number);
  return static_cast<float>(std::bit_cast<double>((bits & ~fraction) | (bits & fraction) << 25U));
}

[[nodiscard]] inline Aabb64 warped(const Aabb& box) noexcept {
  const auto [x, y, z] = box.lower;
  const auto [u, v, w] = box.upper;
  return {{warped(x), warped(y), warped(z)}, {warped(u), warped(v), warped(w)}};
}

[[nodiscard]] inline Aabb unwarped(const Aabb64& box) noexcept {
  const auto [x, y, z] = box.lower;
  const auto [u, v, w] = box.upper;
  return {{unwarped(x), unwarped(y), unwarped(z)}, {unwarped(u), unwarped(v), unwarped(w)}};
}

[[nodiscard]] inline std::vector<Aabb64> warped(const BoxView& boxes) {
  std::vector<Aabb64> all(boxes.size());
  for (std::size_t k = 0; k < all.size(); ++k) all[k] = warped(boxes[k]);
  return all;
}

/// A BroadPhase64 or a Core64 as a BroadPhase or a Core, with the same pairs, so that what tests one of these
/// tests the others.
template <class Subject>
class Warped {
 public:
  template <class... Arguments>
  explicit Warped(Arguments&&... arguments) : subject_(std::forward<Arguments>(arguments)...) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    settle();
    return subject_.add(warped(box), filter);
  }
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters) {
    settle();
    const std::vector<Aabb64> all = warped(boxes);
    return subject_.add(all, filters);
  }
  void move(std::uint32_t id, const Aabb& box) {
    settle();
    subject_.move(id, warped(box));
  }
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
    settle();
    const std::vector<Aabb64> all = warped(boxes);
    subject_.move(ids, all);
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    settle();
    subject_.set_filter(id, filter);
  }
  void set_exclusions(std::span<const Pair> pairs) {
    settle();
    subject_.set_exclusions(pairs);
  }
  template <class Ids>
  void remove(const Ids& ids) {
    settle();
    subject_.remove(ids);
  }

  [[nodiscard]] bool contains(std::uint32_t id) const { return subject_.contains(id); }
  [[nodiscard]] Aabb box(std::uint32_t id) {
    write();
    return unwarped(subject_.box(id));
  }
  [[nodiscard]] Filter filter(std::uint32_t id) const { return subject_.filter(id); }

  std::span<Aabb> map(std::size_t n) {
    write();
    std::vector<Aabb> boxes(n);
    const std::span<Aabb64> memory = subject_.map(n);
    for (std::size_t k = 0; k < n; ++k) boxes[k] = unwarped(memory[k]);
    memory_ = memory;
    boxes_ = std::move(boxes);
    return boxes_;
  }

  /// (If this throws because of a NaN, the boxes of map() may still be written.)
  void begin() {
    write();
    subject_.begin();
    boxes_.clear();
  }
  void begin(const BoxView& boxes) {
    write();
    const std::vector<Aabb64> all = warped(boxes);
    subject_.begin(all);
    boxes_.clear();
  }
  Delta update() requires requires(Subject subject) { subject.update(); }
  {
    write();
    Delta delta = subject_.update();
    boxes_.clear();
    return delta;
  }
  Delta update(const BoxView& boxes) {
    write();
    const std::vector<Aabb64> all = warped(boxes);
    Delta delta = subject_.update(all);
    boxes_.clear();
    return delta;
  }
  Delta finish() {
    write();
    Delta delta = subject_.finish();
    boxes_.clear();
    return delta;
  }

  void shrink() {
    settle();
    subject_.shrink();
  }
  [[nodiscard]] std::vector<Pair> pairs() const { return subject_.pairs(); }
  [[nodiscard]] std::size_t size() const { return subject_.size(); }
  [[nodiscard]] decltype(auto) algorithm() const { return subject_.algorithm(); }

 private:
  /// What was written to the boxes of map().
  void write() {
    for (std::size_t k = 0; k < boxes_.size(); ++k) memory_[k] = warped(boxes_[k]);
  }
  void settle() {
    write();
    boxes_.clear();
  }

  Subject subject_;
  std::vector<Aabb> boxes_;  // of map(), as long as they may be written
  std::span<Aabb64> memory_;
};

}  // namespace broadcl::test
