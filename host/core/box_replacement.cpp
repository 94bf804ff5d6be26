#include "core/box_replacement.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <numeric>
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

/// One block of so many is a sample.
constexpr std::size_t blocks_per_sample = 16;

}  // namespace

void BoxReplacement::begin(std::size_t boxes) {
  counts_.assign(parts_of(boxes), 0);
  boxes_ = boxes;
  beyond_ = 0;
  any_empty_ = false;
}

void BoxReplacement::begin_in_place(std::size_t boxes, std::size_t slots) {
  if (slots > capacity_) {
    const std::size_t capacity = std::max(slots, capacity_ + capacity_ / 2);
    clear();
    replaced_ = std::make_unique_for_overwrite<Replaced[]>(capacity);  // NOLINT(modernize-avoid-c-arrays)
    capacity_ = capacity;
  }
  begin(boxes);
}

/// Calls block(part, slot, boxes) for all boxes of the view, packed, and end(part, thread) after those of a
/// part, unless there is a NaN.
/// @param meanwhile Called first by the calling thread.
template <class Block, class End>
void BoxReplacement::for_each_block(const BoxView& view, const std::function<void()>& meanwhile,
                                    const Block& block, const End& end) {
  LowestFound nan(boxes_);
  std::atomic<bool> any_empty = false;
  bool has_begun = false;  // of the calling thread
  for_each_part(boxes_, threads_, [&](std::size_t first, std::size_t last, std::size_t thread) {
    if (thread == 0 && !std::exchange(has_begun, true)) meanwhile();
    BoxReader reader(view);
    std::array<Aabb, BoxReader::block> packed;
    for (std::size_t slot = first; slot < last; slot += BoxReader::block) {
      std::span<const Aabb> boxes = reader.read(slot, last);
      if (!std::ranges::all_of(boxes, is_proper)) {
        any_empty = true;
        const auto found = std::ranges::find_if(boxes, has_nan);
        if (found != boxes.end()) return nan.add(slot + static_cast<std::size_t>(found - boxes.begin()));
        std::ranges::transform(boxes, packed.begin(), pack);
        boxes = std::span(packed).first(boxes.size());
      }
      block(first / boxes_per_part, slot, boxes);
    }
    finish_stream();  // of this function, or of a Conversion
    if (!nan.any()) end(first / boxes_per_part, thread);
  });
  if (!has_begun) meanwhile();
  if (nan.any()) throw InvalidBox(nan.get());
  any_empty_ = any_empty;
}

void BoxReplacement::copy(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes,
                          const std::function<void()>& meanwhile, const BoxesWritten& written) {
  const std::size_t parts = counts_.size();
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
  sampled_ = blocks_per_sample;
  for_each_block(
      view, meanwhile,
      [&](std::size_t k, std::size_t slot, std::span<const Aabb> from) {
        if (written) {
          stream(from, boxes.data() + slot);
        } else {
          std::ranges::copy(from, boxes.data() + slot);
        }
        if (slot / BoxReader::block % blocks_per_sample != 0) return;
        for (const Aabb& box : from) {
          counts_[k] += static_cast<std::size_t>(!same_bits(before[slot++], box));
        }
      },
      [&](std::size_t k, std::size_t thread) {
        ++parts_copied.at(k / parts_per_piece);
        if (thread == 0) pass_on();  // (a driver may be slower if several threads call it)
      });
  pass_on();
}

void BoxReplacement::replace(const BoxView& view, std::span<Aabb> boxes) {
  sampled_ = 1;
  for_each_block(
      view, [] {},
      [&](std::size_t k, std::size_t slot, std::span<const Aabb> from) {
        Aabb* to = boxes.data() + slot;
        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): as in same_bits()
        if (std::memcmp(to, from.data(), from.size_bytes()) == 0) return;
        Replaced* replaced = replaced_.get() + k * boxes_per_part + counts_[k];
        for (const Aabb& box : from) {  // a branch that depends on the box would be slower
          *replaced = {static_cast<std::uint32_t>(slot++), *to};
          replaced += static_cast<std::ptrdiff_t>(!same_bits(*to, box));
          *to++ = box;
        }
        counts_[k] = static_cast<std::size_t>(replaced - (replaced_.get() + k * boxes_per_part));
      },
      [](std::size_t /*part*/, std::size_t /*thread*/) {});
}

void BoxReplacement::replace(std::uint32_t slot, const Aabb& packed, std::span<Aabb> boxes) noexcept {
  replaced_[boxes_ + beyond_++] = {slot, std::exchange(boxes[slot], packed)};
}

void BoxReplacement::undo(std::span<Aabb> boxes) const noexcept {
  for (std::size_t k = 0; k < counts_.size(); ++k) {
    for (const Replaced& replaced : list(k)) boxes[replaced.slot] = replaced.before;
  }
  for (std::size_t k = boxes_; k < boxes_ + beyond_; ++k) boxes[replaced_[k].slot] = replaced_[k].before;
}

std::size_t BoxReplacement::count() const noexcept {
  return sampled_ * std::accumulate(counts_.begin(), counts_.end(), std::size_t{0});
}

}  // namespace broadcl
