#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

/// A row of the table of algorithms.
struct AlgorithmInfo {
  std::string_view name;     ///< As Config::algorithm takes it.
  std::string_view summary;  ///< One line for people.
  bool on_device;            ///< False for host algorithms, which need no OpenCL.
};

/// The table of algorithms, the only list there is: what is not in it does not exist.
[[nodiscard]] std::span<const AlgorithmInfo> algorithms() noexcept;

/// Keeps a set of moving boxes and tells at each update() which pairs began and which ceased to overlap.
///
/// Not synchronised: one thread at a time may use an object. Different objects are independent of each other
/// and may live on different threads and on different devices. Can be moved, not copied.
class BroadPhase {
 public:
  struct Config {
    std::string device{};                   ///< As select_device() takes it.
    std::string algorithm = "brute-force";  ///< A name of algorithms().
    bool profile = false;  ///< Measure stages on the device too; costs a few microseconds an update.
  };

  /// Opens the device and builds the kernels.
  /// @throws Error for an unknown algorithm or device, and for whatever fails in OpenCL.
  BroadPhase();
  explicit BroadPhase(const Config& config);
  ~BroadPhase();
  BroadPhase(BroadPhase&&) noexcept;
  BroadPhase& operator=(BroadPhase&&) noexcept;

  /// Adds a box and returns its id: the lowest that is free, so that ids stay dense and depend on the
  /// sequence of calls only.
  /// @throws Error for a NaN bound, and where memory for the box cannot be had.
  std::uint32_t add(const Aabb& box);

  /// Replaces the box of an object.
  /// @throws Error for an unknown id and for a NaN bound.
  void move(std::uint32_t id, const Aabb& box);

  /// Removes an object; its id may be given to the next one added. Its pairs appear in `removed` of the next
  /// update.
  /// @throws Error for an unknown id.
  void remove(std::uint32_t id);

  /// Finds every pair of overlapping boxes and returns what changed since the last update.
  /// @throws Error when the device fails or memory is exhausted; objects and known pairs are then as before,
  /// and the
  ///   call may be repeated.
  Delta update();

  /// All pairs as of the last update, in canonical order.
  [[nodiscard]] std::vector<Pair> pairs() const;

  /// Number of objects.
  [[nodiscard]] std::size_t size() const noexcept;

  /// The device in use, null for an algorithm of the host. Owned by this object.
  [[nodiscard]] const Device* device() const noexcept;

  /// The algorithm in use.
  [[nodiscard]] const AlgorithmInfo& algorithm() const noexcept;

  /// The stages of the last update, in order. Valid until the next.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// All overlapping pairs of an array of boxes, by position in the array, in canonical order.
/// @throws Error for a NaN bound (it names the first such box), and as BroadPhase does.
[[nodiscard]] std::vector<Pair> overlapping_pairs(std::span<const Aabb> boxes,
                                                  const BroadPhase::Config& config = BroadPhase::Config());

}  // namespace broadcl
