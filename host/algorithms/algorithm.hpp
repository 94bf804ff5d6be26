#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/broad_phase.hpp>

namespace broadcl {

/// What an algorithm does for a BroadPhase: it stores the boxes, finds the pairs, and remembers those of the
/// last update.
///
/// Boxes lie in slots 0 .. n-1; a slot that is free or whose box is empty holds empty_aabb().
class Algorithm {
 public:
  Algorithm() = default;
  virtual ~Algorithm() = default;
  Algorithm(const Algorithm&) = delete;
  Algorithm& operator=(const Algorithm&) = delete;
  Algorithm(Algorithm&&) = delete;
  Algorithm& operator=(Algorithm&&) = delete;

  /// Makes room for at least this many boxes and keeps those that are there.
  virtual void reserve(std::size_t boxes) = 0;

  /// Where the boxes lie, in memory that is the caller's to write between updates; at least as many as were
  /// reserved. Valid until the next reserve() or update().
  [[nodiscard]] virtual std::span<Aabb> boxes() noexcept = 0;

  /// Tests the first n boxes.
  /// @param renewed Slots whose object is another one than at the last update: what was known of their pairs
  /// ends.
  ///   Ascending.
  virtual Delta update(std::size_t n, std::span<const std::uint32_t> renewed) = 0;

  /// All pairs as of the last update.
  [[nodiscard]] virtual std::vector<Pair> pairs() const = 0;
  /// The device in use, null on the host.
  [[nodiscard]] virtual const Device* device() const noexcept = 0;
  [[nodiscard]] virtual std::span<const Stage> profile() const noexcept = 0;
};

/// A row of the table of algorithms, with what makes it.
struct AlgorithmRow {
  AlgorithmInfo info;
  std::unique_ptr<Algorithm> (*make)(const BroadPhase::Config& config);
};

/// @throws Error that lists the names there are.
[[nodiscard]] const AlgorithmRow& find_algorithm(std::string_view name);

// One line an algorithm, each defined in the file of its name.
[[nodiscard]] std::unique_ptr<Algorithm> make_brute_force(const BroadPhase::Config& config);
[[nodiscard]] std::unique_ptr<Algorithm> make_gpu_bf(const BroadPhase::Config& config);
[[nodiscard]] std::unique_ptr<Algorithm> make_oracle(const BroadPhase::Config& config);

}  // namespace broadcl
