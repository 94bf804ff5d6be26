#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <broadcl/box_view.hpp>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/packed_box.hpp"
#include "base/threads.hpp"

namespace broadcl {

/// The boxes of a view, packed.
/// @param set Is named by the error, before "box": for instance "the first set: ".
/// @throws Error for the first box with a NaN bound; std::bad_alloc.
template <class Box>
[[nodiscard]] std::vector<Box> packed_boxes(const BoxView& boxes, const std::string& set,
                                            const Threads& threads) {
  std::vector<Box> packed(boxes.size());
  LowestFound nan(packed.size());
  for_each_part(packed.size(), threads, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    BoxReader<Box>(boxes).for_each(begin, end, [&](std::size_t k, const Box& box) {
      if (has_nan(box)) nan.add(k);
      packed[k] = pack(box);
    });
  });
  if (nan.any()) throw_nan(set + "box " + std::to_string(nan.get()));
  return packed;
}

}  // namespace broadcl
