#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <broadcl/pair.hpp>

namespace broadcl::python {

/// An (m, 2) uint32 array, which takes the pairs over.
[[nodiscard]] nanobind::object to_array(std::vector<Pair>&& pairs);

/// An (n,) uint32 array, which takes the words over.
[[nodiscard]] nanobind::object to_array(std::vector<std::uint32_t>&& words);

/// Integers 0 .. 2^32 - 1 that a caller gives: one, or an array of them.
class Words {
 public:
  /// @param name What messages call them.
  /// @throws TypeError, ValueError
  Words(nanobind::handle words, const std::string& name);

  /// Those of an array (n, columns), row after row.
  /// @throws TypeError, ValueError
  [[nodiscard]] static Words of_table(nanobind::handle table, const std::string& name, std::size_t columns);

  [[nodiscard]] bool is_single() const noexcept { return is_single_; }
  /// 1 if it is a single one.
  [[nodiscard]] std::size_t size() const noexcept { return words_.size(); }
  /// A single one is the same at any k.
  [[nodiscard]] std::uint32_t operator[](std::size_t k) const noexcept { return words_[is_single_ ? 0 : k]; }

 private:
  std::vector<std::uint32_t> words_;
  bool is_single_ = false;
};

/// An (m, 2) array of pairs that are never to be reported.
/// @throws TypeError, ValueError; also for a pair of an object with itself.
[[nodiscard]] std::vector<Pair> to_exclusions(nanobind::handle pairs);

}  // namespace broadcl::python
