#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "core/queries.hpp"

namespace broadcl::test {

/// Queries of a BroadPhase, or of a Core.
template <class Subject>
[[nodiscard]] Hits overlapping_of(Subject& subject, const BoxView& boxes, const QueryOptions& options) {
  return subject.overlapping(boxes, options);
}
template <class Box>
[[nodiscard]] Hits overlapping_of(Core<Box>& core, const BoxView& boxes, const QueryOptions& options) {
  return Queries<Box>(core, 1).overlapping(boxes, options);
}
template <class Subject>
[[nodiscard]] std::vector<std::uint32_t> partners_of(Subject& subject, std::uint32_t id) {
  return subject.partners(id);
}
template <class Box>
[[nodiscard]] std::vector<std::uint32_t> partners_of(Core<Box>& core, std::uint32_t id) {
  return Queries<Box>(core, 1).partners(id);
}

template <class Subject, class State>
[[nodiscard]] auto restore_to(Subject& subject, const State& state) {
  return subject.restore(state);
}
template <class Box>
[[nodiscard]] Delta restore_to(Core<Box>& core, const std::shared_ptr<const Saved<Box>>& saved) {
  return core.restore(*saved);
}

/// Other numbers in the same order, in double precision. Intervals of as many numbers each become far shorter
/// than the gaps that are then between them. Exact, whatever the rounding mode.
class Warp {
 public:
  struct Intervals {
    double width;     ///< Of each, in single precision.
    int count;        ///< On each side of 0; larger numbers are in one more.
    double distance;  ///< From one's beginning to that of the next, in double precision.
    double length;    ///< Of each, as a part of the distance. (All but the count are powers of two.)
  };
  static constexpr std::array<Intervals, 8> choices{{
      {0.5, 64, 1, 0x1p-29},      // what differs by less than 0.5, single precision cannot tell apart
      {4, 8, 0x1p23, 0x1p-20},    // clusters of metres, 10,000 km apart
      {8, 4, 0x1p23, 0x1p-20},    // the same, and fewer
      {16, 2, 0x1p23, 0x1p-29},   // two clusters of millimetres
      {1, 100, 0x1p16, 0x1p-26},  // towns of millimetres on the earth
      {4, 8, 0x1p1020, 0x1p-24},  // up to the largest numbers
      {8, 6, 0x1p-140, 0x1p-20},  // denormal in single precision
      {2, 32, 1, 0.5},            // gaps as long as intervals
  }};

  /// @param number Any, of which the choice depends.
  explicit Warp(unsigned number = 0) noexcept : in_(choices.at(number % choices.size())) {}

  [[nodiscard]] double operator()(float number) const noexcept {
    const auto exact = static_cast<double>(number);
    if (!std::isfinite(exact)) return exact;
    const double at = std::abs(exact) / in_.width;
    const double interval = std::trunc(at);
    double place = interval + (at - interval) * in_.length;
    if (at >= in_.count)
      place = in_.count + (std::bit_cast<std::uint32_t>(std::abs(number)) - end()) * 0x1p-31;
    return std::copysign(place * in_.distance, exact);
  }

  [[nodiscard]] float inverse(double number) const noexcept {
    if (!std::isfinite(number)) return static_cast<float>(number);
    const double place = std::abs(number) / in_.distance;
    const double interval = std::trunc(place);
    auto result = static_cast<float>((interval + (place - interval) / in_.length) * in_.width);
    if (place >= in_.count) {
      result = std::bit_cast<float>(end() + static_cast<std::uint32_t>((place - in_.count) * 0x1p31));
    }
    return std::signbit(number) ? -result : result;
  }

  [[nodiscard]] Aabb64 operator()(const Aabb& box) const noexcept {
    const auto [x, y, z] = box.lower;
    const auto [u, v, w] = box.upper;
    const Warp& warp = *this;
    return {{warp(x), warp(y), warp(z)}, {warp(u), warp(v), warp(w)}};
  }
  [[nodiscard]] Aabb inverse(const Aabb64& box) const noexcept {
    const auto [x, y, z] = box.lower;
    const auto [u, v, w] = box.upper;
    return {{inverse(x), inverse(y), inverse(z)}, {inverse(u), inverse(v), inverse(w)}};
  }
  [[nodiscard]] std::vector<Aabb64> operator()(const BoxView& boxes) const {
    std::vector<Aabb64> all(boxes.size());
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = (*this)(boxes[k]);
    return all;
  }

 private:
  /// The bits of the first number beyond all intervals.
  [[nodiscard]] std::uint32_t end() const noexcept {
    return std::bit_cast<std::uint32_t>(static_cast<float>(in_.width) * static_cast<float>(in_.count));
  }

  Intervals in_;
};

/// A BroadPhase64 or a Core<Aabb64> as a BroadPhase or a Core, with the same pairs, so that what tests one of
/// these tests the others.
template <class Subject>
class Warped {
 public:
  template <class... Arguments>
  explicit Warped(Arguments&&... arguments) : subject_(std::forward<Arguments>(arguments)...) {}

  /// @pre No object exists.
  void set_warp(const Warp& warp) { warp_ = warp; }

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    settle();
    return subject_.add(warp_(box), filter);
  }
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters) {
    settle();
    const std::vector<Aabb64> all = warp_(boxes);
    return subject_.add(all, filters);
  }
  void move(std::uint32_t id, const Aabb& box) {
    settle();
    subject_.move(id, warp_(box));
  }
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
    settle();
    const std::vector<Aabb64> all = warp_(boxes);
    subject_.move(ids, all);
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    settle();
    subject_.set_filter(id, filter);
  }
  void set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters) {
    settle();
    subject_.set_filters(ids, filters);
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
    return warp_.inverse(subject_.box(id));
  }
  [[nodiscard]] Filter filter(std::uint32_t id) const { return subject_.filter(id); }
  [[nodiscard]] std::vector<std::uint32_t> ids() const { return subject_.ids(); }
  [[nodiscard]] std::vector<Aabb> boxes() requires requires(Subject subject) { subject.boxes().front(); }
  {
    write();
    std::vector<Aabb> boxes;
    for (const Aabb64& box : subject_.boxes()) boxes.push_back(warp_.inverse(box));
    return boxes;
  }
  [[nodiscard]] auto filters() const { return subject_.filters(); }
  [[nodiscard]] auto exclusions() const { return subject_.exclusions(); }

  std::span<Aabb> map(std::size_t n) {
    settle();
    std::vector<Aabb> boxes(n);
    const std::span<Aabb64> memory = subject_.map(n);
    for (std::size_t k = 0; k < n; ++k) boxes[k] = warp_.inverse(memory[k]);
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
    settle();
    const std::vector<Aabb64> all = warp_(boxes);
    subject_.begin(all);
  }
  Delta update() requires requires(Subject subject) { subject.update(); }
  {
    write();
    Delta delta = subject_.update();
    boxes_.clear();
    return delta;
  }
  Delta update(const BoxView& boxes) {
    settle();
    const std::vector<Aabb64> all = warp_(boxes);
    return subject_.update(all);
  }
  Delta finish() {
    write();
    Delta delta = subject_.finish();
    boxes_.clear();
    return delta;
  }

  [[nodiscard]] auto save() {
    write();
    return subject_.save();
  }
  template <class State>
  Delta restore(const State& state) {
    settle();
    return restore_to(subject_, state);
  }

  [[nodiscard]] Hits overlapping(const BoxView& boxes, const QueryOptions& options) {
    write();
    const std::vector<Aabb64> all = warp_(boxes);
    return overlapping_of(subject_, all, options);
  }
  [[nodiscard]] std::vector<std::uint32_t> partners(std::uint32_t id) { return partners_of(subject_, id); }

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
    for (std::size_t k = 0; k < boxes_.size(); ++k) memory_[k] = warp_(boxes_[k]);
  }
  void settle() {
    write();
    boxes_.clear();
  }

  Subject subject_;
  Warp warp_;
  std::vector<Aabb> boxes_;  // of map(), as long as they may be written
  std::span<Aabb64> memory_;
};

}  // namespace broadcl::test
