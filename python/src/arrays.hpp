#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>

namespace broadcl::python {

/// Hands an object to Python, which destroys it when the last array that shows it is gone.
template <class Owner>
nanobind::capsule keep(std::unique_ptr<Owner> owner) {
  nanobind::capsule capsule(owner.get(), [](void* pointer) noexcept { delete static_cast<Owner*>(pointer); });
  (void)owner.release();
  return capsule;
}

/// An (m, 2) uint32 array, which takes the pairs over.
[[nodiscard]] nanobind::object to_array(std::vector<Pair>&& pairs);

/// An (m, 2) uint32 array that shows pairs of the core, and keeps their memory alive; or owns a copy of them
/// if they are few.
[[nodiscard]] nanobind::object to_array(std::span<const Pair> pairs,
                                        const std::shared_ptr<const void>& owner);

/// An (n,) array, which takes the numbers over.
template <class Number>
[[nodiscard]] nanobind::object to_array(std::vector<Number>&& numbers) {
  auto owner = std::make_unique<std::vector<Number>>(std::move(numbers));
  Number* data = owner->data();
  const std::size_t size = owner->size();
  using Array = nanobind::ndarray<nanobind::numpy, Number, nanobind::ndim<1>>;
  return Array(data, {size}, keep(std::move(owner))).cast(nanobind::rv_policy::reference);
}

/// An (n, 6) float32 array, which takes the boxes over: lower x, y, z, upper x, y, z of each.
[[nodiscard]] nanobind::object to_array(std::vector<Aabb>&& boxes);
/// The same in float64.
[[nodiscard]] nanobind::object to_array(std::vector<Aabb64>&& boxes);

/// A (6,) float32 array: lower x, y, z, upper x, y, z.
[[nodiscard]] nanobind::object to_array(const Aabb& box);
/// The same in float64.
[[nodiscard]] nanobind::object to_array(const Aabb64& box);

/// @throws ValueError for an array with masked values, which would be read all the same.
void refuse_masked(nanobind::handle array, const std::string& name);

/// What integers mean to a caller.
struct WordKind {
  bool is_bits = false;     ///< Then -2^31 .. -1 are accepted, too: -1 is all bits, ~1 all but the lowest.
  const char* remedy = "";  ///< The end of the message for an integer that is out of range.
};

/// Integers 0 .. 2^32 - 1 that a caller gives: one, or an array of them.
class Words {
 public:
  /// @param name What messages call them.
  /// @throws TypeError, ValueError
  Words(nanobind::handle words, const std::string& name, const WordKind& kind = {});

  /// Those of an array (n, columns), row after row.
  /// @param columns Any number if it is 0.
  /// @throws TypeError, ValueError
  [[nodiscard]] static Words of_table(nanobind::handle table, const std::string& name, std::size_t columns);

  [[nodiscard]] bool is_single() const noexcept { return is_single_; }
  /// Of a table; 0 if it has neither rows nor columns.
  [[nodiscard]] std::size_t columns() const noexcept { return columns_; }
  [[nodiscard]] std::span<const std::uint32_t> all() const noexcept { return words_; }
  /// 1 if it is a single one.
  [[nodiscard]] std::size_t size() const noexcept { return words_.size(); }
  /// A single one is the same at any k.
  [[nodiscard]] std::uint32_t operator[](std::size_t k) const noexcept { return words_[is_single_ ? 0 : k]; }

 private:
  std::vector<std::uint32_t> words_;
  bool is_single_ = false;
  std::size_t columns_ = 0;
};

/// A number that a caller gives, or an array of them (n,).
/// @param name What messages call them.
/// @throws TypeError, ValueError
[[nodiscard]] std::vector<double> to_numbers(nanobind::handle numbers, const std::string& name);

/// A vector that a caller gives, (dimensions,), or an array of them (n, dimensions).
/// @param dimensions 2 or 3; with 2, the last component is 0.
/// @throws TypeError, ValueError
[[nodiscard]] std::vector<std::array<double, 3>> to_vectors(nanobind::handle vectors, const std::string& name,
                                                            std::size_t dimensions);

/// An (m, 2) array of pairs, read where it is if it is one of uint32 without gaps; otherwise a copy.
class PairArray {
 public:
  /// @param name What messages call them.
  /// @throws TypeError, ValueError
  PairArray(nanobind::handle pairs, const std::string& name);

  [[nodiscard]] std::span<const Pair> all() const noexcept {
    if (!array_.is_valid()) return copy_;
    return {reinterpret_cast<const Pair*>(array_.data()), array_.shape(0)};
  }

 private:
  nanobind::ndarray<const std::uint32_t, nanobind::shape<-1, 2>, nanobind::c_contig, nanobind::device::cpu>
      array_;
  std::vector<Pair> copy_;
};

/// An (m, 2) array of pairs that are never to be reported.
/// @throws TypeError, ValueError; also for a pair of an object with itself.
[[nodiscard]] std::vector<Pair> to_exclusions(nanobind::handle pairs);

/// Those of one search of n boxes, or of two sets; None if there are none.
/// @param second The boxes of the second set, if there is one.
/// @throws As above, and ValueError for a box that is not there.
[[nodiscard]] std::vector<Pair> to_exclusions(nanobind::handle exclusions, std::size_t first,
                                              std::optional<std::size_t> second);

}  // namespace broadcl::python
