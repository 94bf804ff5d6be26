#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/device.hpp>
#include <broadcl/error.hpp>

#include "engines/algorithm.hpp"

namespace broadcl::test {

using Time = std::chrono::steady_clock::time_point;

/// An algorithm that claims to work on a device, and follows orders.
class Pretender final : public Algorithm {
 public:
  /// What it must do.
  struct Orders {
    double expected_seconds = 1;
    std::optional<double> expected_for_all{};  ///< If all slots changed; the same if null.
    std::chrono::microseconds takes{0};        ///< By how much finish() moves the clock on.
    Time* clock = nullptr;                     ///< None if null.
    bool has_no_memory = false;                ///< reserve() throws.
    std::string fails{};                       ///< The function that throws.
    bool is_lost = false;                      ///< pairs() throws, too.
    mutable int updates = 0;                   ///< Made so far.
  };

  /// @param orders Must outlive it.
  explicit Pretender(const Orders& orders, std::string_view algorithm = "oracle")
      : orders_(orders), inner_(make_algorithm({.algorithm = std::string(algorithm)})) {}

  void reserve(std::size_t slots, bool filters) override {
    if (orders_.has_no_memory) throw Error("no memory");
    inner_->reserve(slots, filters);
  }
  void reserve_exclusions(std::size_t count) override {
    may_fail("reserve_exclusions");
    inner_->reserve_exclusions(count);
  }
  void shrink(std::size_t slots) override {
    may_fail("shrink");
    inner_->shrink(slots);
  }
  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return inner_->boxes(); }
  [[nodiscard]] std::span<Aabb> spare_boxes() override { return inner_->spare_boxes(); }
  void swap_boxes() noexcept override { inner_->swap_boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return inner_->boxes_owner(); }
  void begin(const Input& input) override {
    may_fail("begin");
    inner_->begin(input);
  }
  void flush() override {
    may_fail("flush");
    inner_->flush();
  }
  Delta finish() override {
    may_fail("finish");
    if (orders_.clock != nullptr) *orders_.clock += orders_.takes;
    Delta delta = inner_->finish();
    ++orders_.updates;
    return delta;
  }
  [[nodiscard]] Touching touching(AxisSet axes) override {
    may_fail("touching");
    return inner_->touching(axes);
  }
  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t changed) const override {
    return slots == changed ? orders_.expected_for_all.value_or(orders_.expected_seconds)
                            : orders_.expected_seconds;
  }
  [[nodiscard]] std::vector<Pair> pairs() override {
    may_fail("pairs");
    if (orders_.is_lost) throw Error("the device is lost");
    return inner_->pairs();
  }
  [[nodiscard]] const Device* device() const noexcept override { return &device_; }
  [[nodiscard]] MemoryUse memory() const noexcept override { return {.device = 1}; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return inner_->profile(); }

 private:
  void may_fail(std::string_view function) const {
    if (orders_.fails == function) throw Error("the device failed");
  }

  const Orders& orders_;
  AlgorithmPointer inner_;
  Device device_;
};

}  // namespace broadcl::test
