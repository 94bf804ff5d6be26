#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>
#include <broadcl/algorithms.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

namespace broadcl {

/// Boxes in memory of a BroadPhase64, for the caller to write: see BroadPhase64::map(). They may be read as
/// long as this object or a copy of it exists.
struct MappedBoxes64 : std::span<Aabb64> {
  std::shared_ptr<const void> owner{};  ///< Of the memory.
};

/// A BroadPhase whose boxes are in double precision: each update() reports exactly which pairs began and
/// which ceased to overlap or touch as float64, however near or far their bounds, at any distance from 0, on
/// every device and on the host. A box that moves by less than float32 can tell moves.
///
/// Boxes are searched as float32, about an origin near them. Pairs that touch there are compared in float64,
/// on the host: few, unless many boxes lie side by side. To find them, each update in which something has
/// changed looks at all pairs, even if little moved. The origin is chosen from the first boxes, and
/// another one when the boxes have gone so far that many pairs touch in float32 only; that update searches
/// all boxes. Each box takes 48 bytes of the host's memory in addition, 96 with update(boxes).
///
/// Functions, errors, lifetimes and thread safety are those of BroadPhase. Results do not depend on the
/// rounding mode of the calling thread, nor on whether its processor treats denormal numbers as 0.
class BROADCL_API BroadPhase64 {
 public:
  using Config = broadcl::Config;

  /// @throws Error as BroadPhase does.
  BroadPhase64();
  explicit BroadPhase64(const Config& config);
  ~BroadPhase64();
  BroadPhase64(BroadPhase64&&) noexcept;
  BroadPhase64& operator=(BroadPhase64&&) noexcept;

  /// Adds an object and returns its id: BroadPhase::add().
  std::uint32_t add(const Aabb64& box, const Filter& filter = Filter());
  /// Adds an object for each box, in float32 or float64.
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters);
  std::vector<std::uint32_t> add(const BoxView& boxes, const Filter& filter = Filter());

  /// Replaces the box of an object: BroadPhase::move().
  void move(std::uint32_t id, const Aabb64& box);
  /// Replaces the boxes of some objects.
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes);

  /// BroadPhase::set_filter()
  void set_filter(std::uint32_t id, const Filter& filter);
  /// BroadPhase::set_exclusions()
  void set_exclusions(std::span<const Pair> pairs);

  /// Removes an object: BroadPhase::remove().
  void remove(std::uint32_t id);
  /// Removes some objects.
  void remove(std::span<const std::uint32_t> ids);

  /// Whether an object has this id.
  [[nodiscard]] bool contains(std::uint32_t id) const noexcept;
  /// The box of an object, as it will be in the next update.
  [[nodiscard]] Aabb64 box(std::uint32_t id) const;
  /// Its filter.
  [[nodiscard]] Filter filter(std::uint32_t id) const;

  /// For callers who compute all boxes in place: BroadPhase::map(). (The next update reads them once and
  /// converts them; update(boxes) does so while a device receives them.)
  MappedBoxes64 map(std::size_t n);

  /// Finds every pair of overlapping boxes whose filters allow it, and returns what changed since the last
  /// update: BroadPhase::update().
  Delta update();
  /// The same with new boxes for all objects, in float32 or float64; missing objects are added, and objects
  /// beyond the last box are removed.
  Delta update(const BoxView& boxes);

  /// Starts an update on the device and returns at once: BroadPhase::begin().
  void begin();
  /// The same with new boxes for all objects, of which those beyond the last box are removed.
  void begin(const BoxView& boxes);
  /// Waits for the update that begin() started, or does one, and returns the changes: BroadPhase::finish().
  Delta finish();

  /// Gives back memory that the present objects and pairs do not need: BroadPhase::shrink().
  void shrink();

  /// All pairs as of the last update, in canonical order.
  [[nodiscard]] std::vector<Pair> pairs() const;

  /// Number of objects.
  [[nodiscard]] std::size_t size() const noexcept;
  /// The device that will do the next update; null for the host: BroadPhase::device().
  [[nodiscard]] const Device* device() const noexcept;
  /// The algorithm in use.
  [[nodiscard]] const AlgorithmInfo& algorithm() const noexcept;
  /// OpenCL memory in use: BroadPhase::memory().
  [[nodiscard]] MemoryUse memory() const noexcept;
  /// The stages of the last update: BroadPhase::profile(). `touching` finds the pairs that are compared in
  /// float64; gpu-bf does this on the host, as a part of no stage.
  [[nodiscard]] std::span<const Stage> profile() const noexcept;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace broadcl

#endif
