#include "core/exact_boxes.hpp"

#include <algorithm>
#include <array>
#include <atomic>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/pair_lists.hpp"
#include "core/exact_pairs.hpp"
#include "core/exact_reaches.hpp"
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

ExactBoxes::ExactBoxes(const BoxView& first, const BoxView& second, double reach, const Threads& threads)
    : first_(first), second_(second), reach_(reach), threads_(threads) {
  map_ = CoordinateMap(
      size(),
      [this](std::size_t begin, std::span<Aabb64> out) {
        for_each_block(begin, begin + out.size(), [&](std::size_t at, std::span<const Aabb64> block) {
          std::ranges::transform(block, out.subspan(at - begin).begin(), pack<Aabb64>);
        });
      },
      reach > 0, threads);
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

std::vector<float> ExactBoxes::reaches(std::span<const Aabb> packed) const {
  std::vector<float> reaches(reach_ > 0 ? size() : 0);
  for_each_part(reaches.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    const DefaultFloatingPoint as_everywhere;
    for (std::size_t k = begin; k < end; ++k) reaches[k] = reach_of_image(packed[k], reach_);
  });
  return reaches;
}

void ExactBoxes::keep_pairs(std::vector<Pair>& pairs, std::span<const Aabb> packed,
                            std::span<const float> reaches) const {
  if (in_doubt_ == 0 && reaches.empty()) return;
  const std::vector<Pair> touching = touching_pairs(pairs, packed, reaches, in_doubt_, threads_);
  subtract(pairs, pairs_apart(
                      touching, threads_, [this](std::uint32_t k) { return box(k); },
                      [this](std::uint32_t /*k*/) { return reach_; }));
}

}  // namespace broadcl
