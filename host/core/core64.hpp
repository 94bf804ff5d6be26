#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>

#include "base/origin.hpp"
#include "core/core.hpp"
#include "core/exact_pairs.hpp"
#include "core/late_boxes.hpp"

namespace broadcl {

/// A core with boxes in double precision, which it gives to another one in single precision (origin.hpp). Its
/// pairs are those of the other one that overlap in double precision, too. Functions and what they throw are
/// those of Core.
class Core64 {
 public:
  explicit Core64(AlgorithmPointer algorithm, std::size_t threads = 0)
      : exact_(threads), core_(std::move(algorithm), threads), threads_(threads) {
    core_.set_listener(exact_);
  }

  std::uint32_t add(const Aabb64& box, const Filter& filter);
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters);
  void move(std::uint32_t id, const Aabb64& box);
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes);
  void set_filter(std::uint32_t id, const Filter& filter) { core_.set_filter(id, filter); }
  void set_exclusions(std::span<const Pair> pairs) { core_.set_exclusions(pairs); }
  void remove(std::uint32_t id) { core_.remove(id); }
  void remove(std::span<const std::uint32_t> ids) { core_.remove(ids); }

  [[nodiscard]] bool contains(std::uint32_t id) const noexcept { return core_.contains(id); }
  [[nodiscard]] Aabb64 box(std::uint32_t id) const;
  [[nodiscard]] const Filter& filter(std::uint32_t id) const { return core_.filter(id); }

  std::span<Aabb64> map(std::size_t n);
  /// Of the memory that map() returned.
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const noexcept { return boxes_; }

  void begin();
  void begin(const BoxView& boxes);
  void flush();
  Delta finish();
  Delta update(const BoxView& boxes);

  void shrink();

  [[nodiscard]] std::vector<Pair> pairs() const { return exact_.overlapping(core_.pairs()); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept { return core_.profile(); }
  [[nodiscard]] const Algorithm& algorithm() const noexcept { return core_.algorithm(); }
  [[nodiscard]] std::size_t size() const noexcept { return core_.size(); }

 private:
  using Boxes = std::vector<Aabb64>;

  /// Reserves memory for the boxes of this many objects, which have the lowest ids.
  void reserve(std::size_t objects);
  void reserve_late(std::size_t count);
  void store(std::uint32_t id, const Aabb64& box) noexcept;
  [[nodiscard]] std::vector<Aabb64> read(const BoxView& boxes) const;
  /// Boxes in single precision.
  /// @throws Error for the first box with a NaN bound.
  [[nodiscard]] std::vector<Aabb> convert(std::span<const Aabb64> boxes) const;

  [[nodiscard]] bool must_choose() const noexcept;
  /// The best origin for some boxes, or the present one if that is about as good.
  [[nodiscard]] Origin best_origin(std::span<const Aabb64> samples, bool are_flat) const;
  /// The same for the objects.
  [[nodiscard]] Origin choose_origin() const;
  /// Converts all boxes for an origin.
  /// @throws Error for the first box with a NaN bound; then nothing has changed.
  void convert_all(const Origin& origin);

  /// Makes the boxes of a view those of all objects.
  /// @param update Called with a view that the other core can read.
  template <class Update>
  void replace_all(const BoxView& boxes, const Update& update);

  /// Does something that may end the update.
  template <class Function>
  void or_end_update(const Function& function);
  void end_update() noexcept;

  /// Ends an update of the other core.
  /// @param boxes Those of the update.
  /// @param finish Does so.
  template <class Finish>
  Delta finish_core(std::span<const Aabb64> boxes, const Finish& finish);

  ExactPairs exact_;  // of the other core
  Core core_;
  std::size_t threads_;
  std::shared_ptr<Boxes> boxes_ = std::make_shared<Boxes>();  // by id
  std::shared_ptr<Boxes> spare_;                              // to be exchanged for them; null until needed
  LateBoxes<Aabb64> late_;
  std::size_t mapped_ = 0;    // boxes that the caller may have written in place
  bool is_begun_ = false;     // an update
  bool has_changed_ = false;  // a box, perhaps by less than float32 can tell, since the last update

  Origin origin_;
  bool has_origin_ = false;    // It was chosen.
  bool must_convert_ = false;  // Some box may have an extent in z, for which the origin is not made.
  std::size_t updates_ = 0;    // since an origin was chosen
};

}  // namespace broadcl
