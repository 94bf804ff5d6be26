#include "base/box_replacement.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "base/box_reader.hpp"
#include "base/floating_point.hpp"
#include "base/packed_box.hpp"
#include "base/stream.hpp"

namespace broadcl {
namespace {

/// Boxes arrive in pieces, each of which has at least so many parts.
constexpr std::size_t least_parts = 6;

template <class Box>
bool are_same(std::span<const Box> block, const Box* boxes) {
  // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): as in same_bits()
  return std::memcmp(block.data(), boxes, block.size_bytes()) == 0;
}

/// Whether none is empty or has a NaN.
template <class Box>
[[gnu::noinline]] bool are_proper(std::span<const Box> block) {
  bool are = true;
  for (const Box& box : block) are &= packed_overlaps(box, box);
  return are;
}

}  // namespace

template <class Box>
BoxReplacement<Box>::BoxReplacement(const BoxView& view, std::span<const Box> before, std::span<Box> boxes,
                                    bool streams, bool samples, const Threads& threads,
                                    Conversion* conversion)
    : view_(view),
      before_(before),
      boxes_(boxes),
      streams_(streams),
      blocks_per_sample_(samples ? 16 : 1),
      changed_(blocks_of(view.size())),
      nan_(view.size()),
      conversion_(conversion),
      parts_per_piece_(std::max(least_parts, (parts_of(view.size()) + most_pieces - 1) / most_pieces)),
      loop_(parts_of(view.size()), threads_of(view.size(), threads),
            [this](std::size_t part, std::size_t /*thread*/) { copy(part); }) {}

template <class Box>
std::size_t BoxReplacement<Box>::next() {
  const std::size_t begin = piece_ * parts_per_piece_;
  const std::size_t end = begin + parts_per_piece_;
  if (end < parts_of(view_.size())) {
    while (parts_copied_.at(piece_) < parts_per_piece_ && loop_.step()) {
    }
    if (parts_copied_.at(piece_) == parts_per_piece_) {
      ++piece_;
      return end * boxes_per_part;
    }
  }
  finish();
  return view_.size();
}

template <class Box>
void BoxReplacement<Box>::finish() {
  loop_.finish();
  if (is_decided()) return;
  if (nan_.any()) throw InvalidBox(nan_.get());
  if (conversion_ != nullptr) conversion_->finish();
}

template <class Box>
void BoxReplacement<Box>::copy(std::size_t part) {
  if (is_decided()) return;
  const std::size_t end = std::min(view_.size(), (part + 1) * boxes_per_part);
  const DefaultFloatingPoint as_everywhere;
  BoxReader<Box> reader(view_);
  std::array<Box, boxes_per_block> packed;
  std::size_t changed = 0;
  for (std::size_t slot = part * boxes_per_part; slot < end; slot += boxes_per_block) {
    std::span<const Box> block = reader.read(slot, end);
    if (!are_proper(block)) {
      any_empty_ = true;
      const auto found = std::ranges::find_if(block, [](const Box& box) { return has_nan(box); });
      if (found != block.end()) return nan_.add(slot + static_cast<std::size_t>(found - block.begin()));
      std::ranges::transform(block, packed.begin(), pack<Box>);
      block = std::span(packed).first(block.size());
    }
    if (!boxes_.empty()) write(block, boxes_.data() + slot);
    const bool compares = slot / boxes_per_block % blocks_per_sample_ == 0;
    if (compares && !are_same(block, before_.data() + slot)) changed += compare(slot, block);
    if constexpr (std::is_same_v<Box, Aabb64>) {
      if (conversion_ == nullptr) continue;
      std::array<Aabb, boxes_per_block> converted;
      const std::span<Aabb> out = std::span(converted).first(block.size());
      conversion_->convert(slot, block, out);
      write(std::span<const Aabb>(out), conversion_->out().data() + slot);
    }
  }
  if (streams_) finish_stream();
  count_ += changed;
  if (!nan_.any()) ++parts_copied_.at(part / parts_per_piece_);
}

template <class Box>
template <class Some>
void BoxReplacement<Box>::write(std::span<const Some> block, Some* to) const noexcept {
  if (streams_) {
    stream(block, to);
  } else if (!are_same(block, to)) {  // reading takes less time than writing
    std::ranges::copy(block, to);
  }
}

template <class Box>
std::size_t BoxReplacement<Box>::compare(std::size_t slot, std::span<const Box> block) noexcept {
  unsigned changed = 0;
  for (std::size_t k = 0; k < block.size(); ++k)
    changed |= static_cast<unsigned>(!same_bits(before_[slot + k], block[k])) << k;
  changed_[slot / boxes_per_block] = static_cast<std::uint16_t>(changed);
  return static_cast<std::size_t>(std::popcount(changed));
}

template class BoxReplacement<Aabb>;
template class BoxReplacement<Aabb64>;

}  // namespace broadcl
