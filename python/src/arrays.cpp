#include "arrays.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

std::uint32_t to_word(nb::handle number, const std::string& name, const WordKind& kind) {
  const auto integer = nb::steal<nb::object>(PyNumber_Index(number.ptr()));
  if (!integer.is_valid()) throw nb::python_error();
  std::uint32_t word = 0;
  if (nb::try_cast(integer, word)) return word;
  std::int32_t bits = 0;
  if (kind.is_bits && nb::try_cast(integer, bits)) return static_cast<std::uint32_t>(bits);
  const std::string lowest = kind.is_bits ? "-2147483648" : "0";
  throw nb::value_error(
      (name + " must be " + lowest + " to 4294967295, not " + nb::str(integer).c_str() + kind.remedy)
          .c_str());
}

std::vector<Pair> to_pairs(const Words& words) {
  std::vector<Pair> pairs;
  pairs.reserve(words.size() / 2);
  for (std::size_t k = 0; k < words.size(); k += 2) pairs.push_back({words[k], words[k + 1]});
  return pairs;
}

template <class Bound, class Box>
nb::object bounds_of(const Box& box) {
  auto owner = std::make_unique<std::array<Bound, 6>>();
  std::ranges::copy(box.upper, std::ranges::copy(box.lower, owner->begin()).out);
  Bound* data = owner->data();
  using Array = nb::ndarray<nb::numpy, Bound, nb::shape<6>>;
  return Array(data, {6}, keep(std::move(owner))).cast(nb::rv_policy::reference);
}

/// An array that takes items over, each of which is a row of numbers. (nanobind has no arrays of structures.)
template <class Number, std::ptrdiff_t columns, class Item>
nb::object to_table(std::vector<Item>&& items) {
  constexpr std::size_t width = columns;
  static_assert(sizeof(Item) == width * sizeof(Number));
  auto owner = std::make_unique<std::vector<Item>>(std::move(items));
  Item* data = owner->data();
  const std::size_t size = owner->size();
  using Array = nb::ndarray<nb::numpy, Number, nb::shape<-1, columns>>;
  return Array(data, {size, width}, keep(std::move(owner))).cast(nb::rv_policy::reference);
}

/// Numbers in float64, row after row: a single row, or an array of them.
/// @param columns Of each row; 0 if it is a number.
std::vector<double> to_rows(nb::handle numbers, const std::string& name, std::size_t columns) {
  refuse_masked(numbers, name);
  const nb::object numpy = nb::module_::import_("numpy");
  const nb::object any = numpy.attr("asarray")(numbers);
  const nb::object dtype = any.attr("dtype");
  if (const auto kind = nb::cast<std::string>(dtype.attr("kind"));
      kind != "f" && kind != "i" && kind != "u") {
    throw nb::type_error(
        (name + " must be a number or an array of numbers, not " + nb::str(nb::handle(dtype)).c_str())
            .c_str());
  }
  const nb::object shape = any.attr("shape");
  const std::size_t own = columns == 0 ? 0 : 1;
  const std::size_t dimensions = nb::len(shape);
  const bool is_empty_list = dimensions == 1 && nb::cast<std::size_t>(shape[0]) == 0;
  const bool is_row = dimensions >= own && dimensions <= own + 1 &&
                      (columns == 0 || nb::cast<std::size_t>(shape[dimensions - 1]) == columns);
  if (!is_row && !is_empty_list) {
    const std::string row = std::to_string(columns);
    const std::string expected = columns == 0 ? "(n,)" : "(n, " + row + ") or (" + row + ",)";
    throw nb::value_error(
        (name + " must be of shape " + expected + ", not " + nb::str(nb::handle(shape)).c_str()).c_str());
  }
  using Array = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  const auto array =
      nb::cast<Array>(numpy.attr("ascontiguousarray")(any.attr("reshape")(-1), "dtype"_a = "float64"));
  return {array.data(), array.data() + array.shape(0)};
}

void refuse_itself(const Pair& pair, std::size_t row, const std::string& name) {
  if (pair.a != pair.b) return;
  throw nb::value_error(("row " + std::to_string(row) + " of " + name + " has the id " +
                         std::to_string(pair.a) + " twice; give pairs of two ids")
                            .c_str());
}

}  // namespace

nb::object to_array(std::vector<Pair>&& pairs) {
  return to_table<std::uint32_t, 2>(std::move(pairs));
}

nb::object to_array(std::vector<Aabb>&& boxes) {
  return to_table<float, 6>(std::move(boxes));
}

nb::object to_array(std::vector<Aabb64>&& boxes) {
  return to_table<double, 6>(std::move(boxes));
}

nb::object to_array(std::span<const Pair> pairs, const std::shared_ptr<const void>& owner) {
  // To copy these takes a microsecond or two; to store them otherwise would keep a whole buffer of the
  // device.
  constexpr std::size_t few = 2048;
  if (pairs.size() <= few) return to_array(std::vector<Pair>(pairs.begin(), pairs.end()));
  // Whatever is written to the array, nobody but the caller reads it.
  auto* words = const_cast<std::uint32_t*>(reinterpret_cast<const std::uint32_t*>(pairs.data()));
  using Array = nb::ndarray<nb::numpy, std::uint32_t, nb::shape<-1, 2>>;
  return Array(words, {pairs.size(), 2}, keep(std::make_unique<std::shared_ptr<const void>>(owner)))
      .cast(nb::rv_policy::reference);
}

nb::object to_array(const Aabb& box) {
  return bounds_of<float>(box);
}

nb::object to_array(const Aabb64& box) {
  return bounds_of<double>(box);
}

void refuse_masked(nb::handle array, const std::string& name) {
  if (!nb::hasattr(array, "mask")) return;
  const nb::object masked = nb::module_::import_("numpy").attr("ma").attr("is_masked");
  if (!nb::cast<bool>(masked(array))) return;
  throw nb::value_error(
      (name + " has masked values; leave them out, or replace boxes by broadcl.EMPTY").c_str());
}

Words::Words(nb::handle words, const std::string& name, const WordKind& kind) {
  if (PyLong_Check(words.ptr())) {
    words_ = {to_word(words, name, kind)};
    is_single_ = true;
    return;
  }
  refuse_masked(words, name);
  using Array = nb::ndarray<const std::uint32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  Array array;
  if (!nb::hasattr(words, "__dlpack__") || !nb::try_cast(words, array, false)) {
    const nb::object numpy = nb::module_::import_("numpy");
    const nb::object any = numpy.attr("asarray")(words);
    const nb::object dtype = any.attr("dtype");
    const nb::object shape = any.attr("shape");
    const auto type = nb::cast<std::string>(dtype.attr("kind"));
    const bool is_empty = nb::cast<std::size_t>(any.attr("size")) == 0;
    const auto dimensions = nb::cast<std::size_t>(any.attr("ndim"));
    if (type != "i" && type != "u" && !is_empty) {
      throw nb::type_error(
          (name + " must be an integer or an array of integers, not " + nb::str(nb::handle(dtype)).c_str())
              .c_str());
    }
    if (dimensions == 0) {
      words_ = {to_word(any.attr("item")(), name, kind)};
      is_single_ = true;
      return;
    }
    if (dimensions != 1) {
      throw nb::value_error(
          (name + " must be of shape (n,), not " + nb::str(nb::handle(shape)).c_str()).c_str());
    }
    if (is_empty) return;
    (void)to_word(any.attr("min")(), name, kind);
    (void)to_word(any.attr("max")(), name, kind);
    array = nb::cast<Array>(numpy.attr("ascontiguousarray")(any, "dtype"_a = "uint32"));
  }
  words_.assign(array.data(), array.data() + array.shape(0));
}

Words Words::of_table(nb::handle table, const std::string& name, std::size_t columns) {
  refuse_masked(table, name);
  const nb::object any = nb::module_::import_("numpy").attr("asarray")(table);
  const nb::object shape = any.attr("shape");
  const std::size_t found = nb::len(shape) == 2 ? nb::cast<std::size_t>(shape[1]) : 0;
  const bool is_table = columns == 0 ? found > 0 : found == columns;
  if (!is_table && nb::cast<std::size_t>(any.attr("size")) != 0) {
    const std::string expected = columns == 0 ? "k" : std::to_string(columns);
    throw nb::value_error(
        (name + " must be of shape (n, " + expected + "), not " + nb::str(nb::handle(shape)).c_str())
            .c_str());
  }
  Words words(any.attr("reshape")(-1), name);
  words.columns_ = found;
  return words;
}

std::vector<double> to_numbers(nb::handle numbers, const std::string& name) {
  return to_rows(numbers, name, 0);
}

std::vector<std::array<double, 3>> to_vectors(nb::handle vectors, const std::string& name,
                                              std::size_t dimensions) {
  const std::vector<double> numbers = to_rows(vectors, name, dimensions);
  std::vector<std::array<double, 3>> result(numbers.size() / dimensions);
  for (std::size_t k = 0; k < numbers.size(); ++k) result[k / dimensions].at(k % dimensions) = numbers[k];
  return result;
}

PairArray::PairArray(nb::handle pairs, const std::string& name) {
  refuse_masked(pairs, name);
  if (nb::hasattr(pairs, "__dlpack__") && nb::try_cast(pairs, array_, false)) return;
  copy_ = to_pairs(Words::of_table(pairs, name, 2));
}

std::vector<Pair> to_exclusions(nb::handle pairs) {
  std::vector<Pair> exclusions = to_pairs(Words::of_table(pairs, "pairs", 2));
  for (std::size_t k = 0; k < exclusions.size(); ++k) refuse_itself(exclusions[k], k, "pairs");
  return exclusions;
}

std::vector<Pair> to_exclusions(nb::handle exclusions, std::size_t first, std::optional<std::size_t> second) {
  if (exclusions.is_none()) return {};
  std::vector<Pair> pairs = to_pairs(Words::of_table(exclusions, "exclusions", 2));
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (!second) refuse_itself(pairs[k], k, "exclusions");
    if (pairs[k].a < first && pairs[k].b < second.value_or(first)) continue;
    throw nb::value_error(
        ("row " + std::to_string(k) + " of exclusions is (" + std::to_string(pairs[k].a) + ", " +
         std::to_string(pairs[k].b) + "), but there " + (first == 1 ? "is " : "are ") +
         std::to_string(first) + (first == 1 ? " box" : " boxes") +
         (second ? " in a and " + std::to_string(*second) + " in b" : "") + "; give their indices")
            .c_str());
  }
  return pairs;
}

}  // namespace broadcl::python
