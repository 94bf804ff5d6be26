#include "core/box_replacement.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstring>
#include <utility>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/packed_box.hpp"
#include "base/stream.hpp"

namespace broadcl {
namespace {

/// Boxes are passed on in this many pieces, or fewer, each of which has at least so many parts.
constexpr std::size_t most_pieces = 8;
constexpr std::size_t least_parts = 6;

}  // namespace

void BoxReplacement::begin(std::size_t boxes) {
  changed_.resize((boxes + BoxReader::block - 1) / BoxReader::block);
  boxes_ = boxes;
}

void BoxReplacement::copy(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes,
                          const std::function<void()>& meanwhile, const BoxesWritten& written) {
  const std::size_t parts = parts_of(boxes_);
  const std::size_t parts_per_piece = std::max(least_parts, (parts + most_pieces - 1) / most_pieces);
  std::array<std::atomic<std::size_t>, most_pieces> parts_copied{};  // of each piece
  std::size_t next = 0;                                              // the first piece that was not passed on
  const auto pass_on = [&] {
    if (!written) return;
    for (; next * parts_per_piece < parts; ++next) {
      const std::size_t first = next * parts_per_piece;
      const std::size_t last = std::min(parts, first + parts_per_piece);
      if (parts_copied.at(next) < last - first) return;
      written(first * boxes_per_part, std::min(boxes_, last * boxes_per_part));
    }
  };
  LowestFound nan(boxes_);
  std::atomic<std::size_t> changed = 0;
  std::atomic<bool> any_empty = false;
  bool has_begun = false;  // of the calling thread
  for_each_part(boxes_, threads_, [&](std::size_t first, std::size_t last, std::size_t thread) {
    if (thread == 0 && !std::exchange(has_begun, true)) meanwhile();
    BoxReader reader(view);
    std::array<Aabb, BoxReader::block> packed;
    std::size_t count = 0;
    for (std::size_t slot = first; slot < last; slot += BoxReader::block) {
      std::span<const Aabb> from = reader.read(slot, last);
      if (!std::ranges::all_of(from, is_proper)) {
        any_empty = true;
        const auto found = std::ranges::find_if(from, has_nan);
        if (found != from.end()) return nan.add(slot + static_cast<std::size_t>(found - from.begin()));
        std::ranges::transform(from, packed.begin(), pack);
        from = std::span(packed).first(from.size());
      }
      if (written) {
        stream(from, boxes.data() + slot);
      } else {
        std::ranges::copy(from, boxes.data() + slot);
      }
      count += compare(slot, before, from);
    }
    changed += count;
    finish_stream();  // of this function, or of a Conversion
    if (nan.any()) return;
    ++parts_copied.at(first / boxes_per_part / parts_per_piece);
    if (thread == 0) pass_on();  // (a driver may be slower if several threads call it)
  });
  if (!has_begun) meanwhile();
  if (nan.any()) throw InvalidBox(nan.get());
  pass_on();
  count_ = changed;
  any_empty_ = any_empty;
}

std::size_t BoxReplacement::compare(std::size_t slot, std::span<const Aabb> before,
                                    std::span<const Aabb> block) noexcept {
  unsigned changed = 0;
  // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): as in same_bits()
  if (std::memcmp(before.data() + slot, block.data(), block.size_bytes()) != 0) {
    for (std::size_t k = 0; k < block.size(); ++k) {
      changed |= static_cast<unsigned>(!same_bits(before[slot + k], block[k])) << k;
    }
  }
  changed_[slot / BoxReader::block] = static_cast<std::uint16_t>(changed);
  return static_cast<std::size_t>(std::popcount(changed));
}

}  // namespace broadcl
