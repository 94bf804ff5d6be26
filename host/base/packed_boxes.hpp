#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// Copies the boxes of a view, packed.
/// @param set Is named by the error, before "box": for instance "the first set: ".
/// @param packed Memory for them.
/// @throws Error for the first box with a NaN bound; std::bad_alloc.
template <class Box>
void pack_boxes(const BoxView& boxes, const std::string& set, const Threads& threads, std::span<Box> packed) {
  LowestFound nan(boxes.size());
  for_each_part(boxes.size(), threads, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    BoxReader<Box>(boxes).for_each(begin, end, [&](std::size_t k, const Box& box) {
      if (has_nan(box)) nan.add(k);
      packed[k] = pack(box);
    });
  });
  if (nan.any()) throw_nan(set + "box " + std::to_string(nan.get()));
}

/// The same to memory of its own.
template <class Box>
[[nodiscard]] std::vector<Box> packed_boxes(const BoxView& boxes, const Threads& threads) {
  std::vector<Box> packed(boxes.size());
  pack_boxes<Box>(boxes, "", threads, packed);
  return packed;
}

}  // namespace broadcl
