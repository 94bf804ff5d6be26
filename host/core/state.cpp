#include "core/state.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <string>

#include <broadcl/version.h>
#include <broadcl/error.hpp>

#include "core/exclusions.hpp"
#include "core/reach.hpp"

namespace broadcl {
namespace {

/// The bytes begin with this. Each list follows its size. All numbers are little-endian.
template <class Box>
constexpr std::array<std::uint64_t, 2> state_kind{std::uint64_t{0x534c4342} << 32U | BROADCL_VERSION_NUMBER,
                                                  8 * sizeof(BoundType<Box>)};

/// Calls a function with each list of a state, and with the bytes of each of its numbers.
template <class Box, class Lists, class Pairs, class Function>
void for_each_list(Lists& saved, Pairs& exclusions, const Function& function) {
  function(saved.boxes, sizeof(BoundType<Box>));
  function(saved.reaches, sizeof(BoundType<Box>));
  function(saved.filters, sizeof(std::uint32_t));
  function(exclusions, sizeof(std::uint32_t));
  function(saved.live, 1);
}

/// @param width Bytes of each number.
void swap_if_big_endian(std::span<std::byte> numbers, std::size_t width) {
  if constexpr (std::endian::native == std::endian::big) {
    for (; !numbers.empty(); numbers = numbers.subspan(width)) std::ranges::reverse(numbers.first(width));
  }
}

void refuse_damaged(bool is_damaged) {
  if (is_damaged) throw Error::invalid_argument("the bytes of the state are damaged; save it again");
}

}  // namespace

template <class Box>
std::vector<std::byte> BasicState<Box>::bytes() const {
  std::vector<std::byte> bytes;
  const auto append = [&](const auto& numbers, std::size_t width) {
    const auto some = std::as_bytes(std::span(numbers));
    bytes.resize(bytes.size() + some.size());
    const auto to = std::span(bytes).last(some.size());
    std::ranges::copy(some, to.begin());
    swap_if_big_endian(to, width);
  };
  append(state_kind<Box>, sizeof(std::uint64_t));
  append(std::array{saved_->first_reach}, sizeof(BoundType<Box>));
  for_each_list<Box>(*saved_, *saved_->exclusions, [&](const auto& list, std::size_t width) {
    append(std::array{std::uint64_t{list.size()}}, sizeof(std::uint64_t));
    append(list, width);
  });
  return bytes;
}

template <class Box>
BasicState<Box> BasicState<Box>::from_bytes(std::span<const std::byte> bytes) {
  const auto take = [&](auto& numbers, std::size_t width) {
    const auto to = std::as_writable_bytes(std::span(numbers));
    refuse_damaged(to.size() > bytes.size());
    std::ranges::copy(bytes.first(to.size()), to.begin());
    swap_if_big_endian(to, width);
    bytes = bytes.subspan(to.size());
  };
  std::array<std::uint64_t, 2> kind{};
  take(kind, sizeof(std::uint64_t));
  if (kind != state_kind<Box>) {
    throw Error::invalid_argument("the bytes are not those of a state in float" +
                                  std::to_string(state_kind<Box>[1]) +
                                  " of this version; restore those that such an object has saved");
  }
  std::array<BoundType<Box>, 1> first_reach{};
  take(first_reach, sizeof(BoundType<Box>));
  Saved<Box> saved{.first_reach = first_reach[0]};
  std::vector<Pair> exclusions;
  for_each_list<Box>(saved, exclusions, [&](auto& list, std::size_t width) {
    std::array<std::uint64_t, 1> size{};
    take(size, sizeof(std::uint64_t));
    refuse_damaged(size[0] > bytes.size() / sizeof *list.data());
    list.resize(size[0]);
    take(list, width);
  });
  const auto [boxes, live, filters, reaches] =
      std::array{saved.boxes.size(), saved.live.size(), saved.filters.size(), saved.reaches.size()};
  refuse_damaged(!bytes.empty() || live != boxes || (filters > 0 && filters != boxes) ||
                 (reaches > 0 && (reaches != boxes || saved.first_reach != 0)));
  for (std::size_t slot = 0; slot < boxes; ++slot) {
    const Box& box = saved.boxes[slot];
    refuse_damaged(has_nan(box) || saved.live[slot] > 1 || (saved.live[slot] == 0 && !is_empty(box)));
  }
  refuse_invalid_reach(saved.first_reach);
  for (const auto reach : saved.reaches) refuse_invalid_reach(reach);
  refuse_damaged(sorted_exclusions(exclusions) != exclusions);
  saved.exclusions = std::make_shared<const std::vector<Pair>>(std::move(exclusions));
  return BasicState(std::make_shared<const Saved<Box>>(std::move(saved)));
}

template class BasicState<Aabb>;
template class BasicState<Aabb64>;

}  // namespace broadcl
