#include "base/box_replacement.hpp"

#include <algorithm>
#include <cstring>

#include "base/packed_box.hpp"
#include "base/stream.hpp"

namespace broadcl {
namespace {

/// Boxes arrive in pieces, each of which has at least so many parts.
constexpr std::size_t least_parts = 6;

bool are_same(std::span<const Aabb> block, const Aabb* boxes) {
  // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): as in same_bits()
  return std::memcmp(block.data(), boxes, block.size_bytes()) == 0;
}

}  // namespace

BoxReplacement::BoxReplacement(const BoxView& view, std::span<const Aabb> before, std::span<Aabb> boxes,
                               bool streams, bool samples, std::size_t threads)
    : view_(view),
      before_(before),
      boxes_(boxes),
      streams_(streams),
      blocks_per_sample_(samples ? 16 : 1),
      changed_((view.size() + BoxReader::block - 1) / BoxReader::block),
      nan_(view.size()),
      parts_per_piece_(std::max(least_parts, (parts_of(view.size()) + most_pieces - 1) / most_pieces)),
      loop_(parts_of(view.size()), threads_of(view.size(), threads),
            [this](std::size_t part, std::size_t /*thread*/) { copy(part); }) {}

std::size_t BoxReplacement::next() {
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

void BoxReplacement::finish() {
  loop_.finish();
  if (nan_.any()) throw InvalidBox(nan_.get());
}

void BoxReplacement::copy(std::size_t part) {
  const std::size_t end = std::min(view_.size(), (part + 1) * boxes_per_part);
  BoxReader reader(view_);
  std::array<Aabb, BoxReader::block> packed;
  std::size_t changed = 0;
  for (std::size_t slot = part * boxes_per_part; slot < end; slot += BoxReader::block) {
    std::span<const Aabb> block = reader.read(slot, end);
    if (!std::ranges::all_of(block, is_proper)) {
      any_empty_ = true;
      const auto found = std::ranges::find_if(block, has_nan);
      if (found != block.end()) return nan_.add(slot + static_cast<std::size_t>(found - block.begin()));
      std::ranges::transform(block, packed.begin(), pack);
      block = std::span(packed).first(block.size());
    }
    if (streams_) {
      stream(block, boxes_.data() + slot);
    } else if (!are_same(block, boxes_.data() + slot)) {  // reading takes less time than writing
      std::ranges::copy(block, boxes_.data() + slot);
    }
    if (slot / BoxReader::block % blocks_per_sample_ == 0) changed += compare(slot, block);
  }
  finish_stream();  // of this function, or of a Conversion
  count_ += changed;
  if (!nan_.any()) ++parts_copied_.at(part / parts_per_piece_);
}

std::size_t BoxReplacement::compare(std::size_t slot, std::span<const Aabb> block) noexcept {
  unsigned changed = 0;
  if (!are_same(block, before_.data() + slot)) {
    for (std::size_t k = 0; k < block.size(); ++k) {
      changed |= static_cast<unsigned>(!same_bits(before_[slot + k], block[k])) << k;
    }
  }
  changed_[slot / BoxReader::block] = static_cast<std::uint16_t>(changed);
  return static_cast<std::size_t>(std::popcount(changed));
}

}  // namespace broadcl
