#include "core/exact_boxes.hpp"

#include <algorithm>
#include <array>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/packed_box.hpp"
#include "base/parallel.hpp"
#include "base/prefetch.hpp"

namespace broadcl {

ExactBoxes::ExactBoxes(const BoxView& first, const BoxView& second, std::size_t threads)
    : first_(first), second_(second), threads_(threads) {
  origin_ =
      Origin(sample(size(), [&](std::size_t k) { return box(k); }), first.are_flat() && second.are_flat());
}

std::size_t ExactBoxes::pack_to(std::span<Aabb> out) const {
  const std::size_t invalid = pack(first_, out);
  return invalid < first_.size() ? invalid : invalid + pack(second_, out.subspan(first_.size()));
}

/// Returns the first box with a NaN, or their number.
std::size_t ExactBoxes::pack(const BoxView& view, std::span<Aabb> out) const {
  LowestFound invalid(view.size());
  for_each_part(view.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    std::array<Aabb64, BoxReader::block> exact;
    for (std::size_t first = begin; first < end; first += exact.size()) {
      const std::size_t count = std::min(exact.size(), end - first);
      view.read(first, std::span(exact).first(count));
      const std::span<Aabb> packed = out.subspan(first, count);
      origin_.convert(std::span(exact).first(count), packed);
      for (std::size_t k = 0; k < count; ++k) {
        if (is_proper(packed[k])) continue;
        if (has_nan(packed[k])) return invalid.add(first + k);
        packed[k] = packed_empty();
      }
    }
  });
  return invalid.get();
}

void ExactBoxes::keep_overlapping(std::vector<Pair>& pairs, std::span<const Aabb> packed) const {
  constexpr std::size_t pairs_per_thread = 1 << 14;  // at least
  // One part per thread: what remains of each but the first is moved once more.
  const std::size_t parts = useful_threads(pairs.size(), pairs_per_thread, threads_);
  const auto begin_of = [&](std::size_t part) { return pairs.size() * part / parts; };
  std::vector<std::size_t> kept(parts);
  parallel_for(parts, parts, [&](std::size_t part, std::size_t /*thread*/) {
    const std::size_t begin = begin_of(part);
    kept[part] = keep(std::span(pairs).subspan(begin, begin_of(part + 1) - begin), packed);
  });
  auto end = pairs.begin() + static_cast<std::ptrdiff_t>(kept[0]);
  for (std::size_t part = 1; part < parts; ++part) {
    const auto begin = pairs.begin() + static_cast<std::ptrdiff_t>(begin_of(part));
    end =
        end == begin ? begin + static_cast<std::ptrdiff_t>(kept[part]) : std::copy_n(begin, kept[part], end);
  }
  pairs.erase(end, pairs.end());
}

/// Moves the pairs that remain to the front; returns how many.
std::size_t ExactBoxes::keep(std::span<Pair> pairs, std::span<const Aabb> packed) const noexcept {
  constexpr std::size_t ahead = 16;
  std::size_t count = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (k + ahead < pairs.size()) prefetch(&packed[pairs[k + ahead].a]);
    const Pair pair = pairs[k];
    if (packed_touch(packed[pair.a], packed[pair.b]) && !overlaps(box(pair.a), box(pair.b))) continue;
    pairs[count++] = pair;
  }
  return count;
}

}  // namespace broadcl
