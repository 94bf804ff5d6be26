#include "core/exact_boxes.hpp"

#include <algorithm>
#include <array>
#include <atomic>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/pair_lists.hpp"
#include "core/exact_pairs.hpp"
#include "engines/touching.hpp"

namespace broadcl {

template <class Function>
void ExactBoxes::for_each_block(std::size_t begin, std::size_t end, const Function& function) const {
  BoxReader<Aabb64> first(first_);
  BoxReader<Aabb64> second(second_);
  while (begin < end) {
    const std::span<const Aabb64> block = begin < first_.size()
                                              ? first.read(begin, std::min(end, first_.size()))
                                              : second.read(begin - first_.size(), end - first_.size());
    function(begin, block);
    begin += block.size();
  }
}

ExactBoxes::ExactBoxes(const BoxView& first, const BoxView& second, std::size_t threads)
    : first_(first), second_(second), threads_(threads) {
  map_ = CoordinateMap(
      size(),
      [this](std::size_t begin, std::span<Aabb64> out) {
        for_each_block(begin, begin + out.size(), [&](std::size_t at, std::span<const Aabb64> block) {
          std::ranges::transform(block, out.subspan(at - begin).begin(), pack<Aabb64>);
        });
      },
      threads);
}

std::size_t ExactBoxes::pack_to(std::span<Aabb> out) {
  LowestFound invalid(size());
  std::atomic<AxisSet> in_doubt = 0;
  for_each_part(size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    std::array<Aabb64, boxes_per_block> packed;
    AxisSet found = 0;
    for_each_block(begin, end, [&](std::size_t at, std::span<const Aabb64> block) {
      const auto nan = std::ranges::find_if(block, [](const Aabb64& box) { return has_nan(box); });
      if (nan != block.end()) return invalid.add(at + static_cast<std::size_t>(nan - block.begin()));
      std::ranges::transform(block, packed.begin(), pack<Aabb64>);
      found |= map_.convert(std::span(packed).first(block.size()), out.subspan(at, block.size()));
    });
    in_doubt |= found & CoordinateMap::in_doubt;
  });
  in_doubt_ = in_doubt;
  return invalid.get();
}

void ExactBoxes::keep_overlapping(std::vector<Pair>& pairs, std::span<const Aabb> packed) const {
  if (in_doubt_ == 0) return;
  const std::vector<Pair> touching = touching_pairs(pairs, packed, in_doubt_, threads_);
  subtract(pairs, pairs_apart(touching, threads_, [this](std::uint32_t k) { return box(k); }));
}

}  // namespace broadcl
