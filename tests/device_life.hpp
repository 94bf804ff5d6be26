#pragma once

#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/opencl.hpp>

#include "each_algorithm.hpp"
#include "opencl/devices.hpp"
#include "reference.hpp"
#include "trouble.hpp"

namespace broadcl::test {

/// A caller's queue, and buffers in its context.
class CallersQueue {
 public:
  explicit CallersQueue(cl_command_queue_properties properties = 0) : queue_(context_, device_, properties) {}

  template <class T>
  [[nodiscard]] cl::Buffer buffer_of(const std::vector<T>& values) const {
    const std::size_t bytes = std::max<std::size_t>(1, values.size() * sizeof(T));
    cl::Buffer buffer(context_, CL_MEM_READ_WRITE, bytes);
    if (!values.empty()) queue_.enqueueWriteBuffer(buffer, CL_TRUE, 0, bytes, values.data());
    return buffer;
  }

  /// The four numbers that enqueue() reports.
  [[nodiscard]] std::array<std::uint32_t, 4> read_counts(const cl::Buffer& counts) const {
    std::array<std::uint32_t, 4> words{};
    queue_.enqueueReadBuffer(counts, CL_TRUE, 0, sizeof words, words.data());
    return words;
  }

  [[nodiscard]] Pairs read(const DeviceBroadPhase::PairBuffer& list) const {
    Pairs pairs(list.count);
    if (!pairs.empty()) {
      queue_.enqueueReadBuffer(cl::Buffer(list.buffer, true), CL_TRUE, 0, pairs.size() * sizeof(Pair),
                               pairs.data());
    }
    return pairs;
  }

  [[nodiscard]] cl_command_queue operator()() const { return queue_(); }

 protected:
  cl::Device device_{opencl::open(select_device())};
  cl::Context context_{device_};
  cl::CommandQueue queue_;
};

/// A DeviceBroadPhase over a few frames. Each update is repeated if it fails, and all answers must be those
/// of the reference.
template <class Trouble>
class DeviceLife {
 public:
  DeviceLife(const CallersQueue& queue, const DeviceBroadPhase::Config& config, Trouble trouble,
             Habits habits)
      : queue_(queue), broad_phase_(queue(), config), trouble_(trouble), habits_(habits) {}

  /// @returns Whether every answer was right; it stops at the first wrong one.
  bool live() {
    try {
      update(20, 0.7F);
      update(30, 0.6F, 3);
      update(200, 0.001F);  // all pair
      if (is_right_) trouble_.call([&] { broad_phase_.shrink(); }, [&] { look(reference_.pairs()); });
      update(25, 0.3F, 5);
      if (is_right_) trouble_.call([&] { broad_phase_.shrink(); }, [&] { look(reference_.pairs()); });
      enqueue(28, 0.5F, 3);
      enqueue(30, 0.4F);
      update(0, 1);
      update(24, 0.4F);
    } catch (const std::exception& error) {
      expect(::testing::AssertionFailure() << "a call fails by itself: " << error.what());
    }
    return is_right_;
  }

  [[nodiscard]] const Trouble& trouble() const { return trouble_; }

 private:
  void expect(const ::testing::AssertionResult& result) {
    EXPECT_TRUE(result);
    is_right_ = is_right_ && result;
  }

  /// Boxes in a row on the device, in as many groups as requested.
  struct Given {
    cl::Buffer boxes, filters;
    DeviceBroadPhase::Boxes arguments;
  };
  Given give(std::uint32_t n, float distance, std::uint32_t groups) {
    std::vector<Aabb> boxes;
    std::vector<Filter> filters;
    reference_.map(n);
    for (std::uint32_t k = 0; k < n; ++k) {
      const float x = static_cast<float>(k) * distance;
      boxes.push_back({{x, 0, 0}, {x + 1, 1, 1}});
      filters.push_back(groups == 0 ? Filter()
                                    : Filter{.mask = k % groups == 0 ? 0U : 1U, .body = k / groups});
      reference_.move(k, boxes[k]);
      reference_.set_filter(k, filters[k]);
    }
    Given given{.boxes = queue_.buffer_of(boxes), .filters = queue_.buffer_of(filters), .arguments = {}};
    given.arguments = {
        .buffer = given.boxes(), .count = n, .filters = groups == 0 ? nullptr : given.filters()};
    return given;
  }

  void look(const Pairs& known) {
    if (habits_.looks) expect(same("known", queue_.read(broad_phase_.pairs()), known));
  }

  void update(std::uint32_t n, float distance, std::uint32_t groups = 0) {
    if (!is_right_) return;
    const Given given = give(n, distance, groups);
    const Pairs known = reference_.pairs();
    const auto result = trouble_.call(
        [&] {
          broad_phase_.begin(given.arguments);
          return broad_phase_.finish();
        },
        [&] { look(known); });
    const Reference::Changes changes = reference_.finish();
    expect(same("added", queue_.read(result.added), changes.added));
    expect(same("removed", queue_.read(result.removed), changes.removed));
    if (!is_right_) return;
    const auto all = trouble_.call([&] { return broad_phase_.pairs(); }, [] {});
    expect(same("all", queue_.read(all), reference_.pairs()));
  }

  void enqueue(std::uint32_t n, float distance, std::uint32_t groups = 0) {
    if (!is_right_) return;
    const Given given = give(n, distance, groups);
    const Pairs known = reference_.pairs();
    const cl::Buffer added = queue_.buffer_of(Pairs(most_changes));
    const cl::Buffer removed = queue_.buffer_of(Pairs(most_changes));
    const cl::Buffer counts = queue_.buffer_of(std::vector<std::uint32_t>(4));
    trouble_.call([&] { broad_phase_.reserve(30, 2 * most_changes, true); }, [&] { look(known); });
    trouble_.call(
        [&] {
          broad_phase_.enqueue(
              given.arguments,
              {.added = added(), .removed = removed(), .capacity = most_changes, .counts = counts()});
        },
        [&] { look(known); });
    const Reference::Changes changes = reference_.finish();
    const auto words = queue_.read_counts(counts);
    expect(words[2] == reference_.pairs().size() && words[3] == 0
               ? ::testing::AssertionSuccess()
               : ::testing::AssertionFailure() << "counts " << ::testing::PrintToString(words));
    if (!is_right_) return;
    expect(same("added", queue_.read({.buffer = added(), .count = words[0]}), changes.added));
    expect(same("removed", queue_.read({.buffer = removed(), .count = words[1]}), changes.removed));
  }

  static constexpr std::size_t most_changes = 435;  // every pair of 30

  const CallersQueue& queue_;
  DeviceBroadPhase broad_phase_;
  Reference reference_;
  Trouble trouble_;
  Habits habits_;
  bool is_right_ = true;
};

}  // namespace broadcl::test
