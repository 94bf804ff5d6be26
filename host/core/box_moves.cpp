#include "core/box_moves.hpp"

#include <atomic>
#include <numeric>
#include <string>
#include <utility>

namespace broadcl {

template <class Box>
BoxMoves<Box>::BoxMoves(std::span<const std::uint32_t> ids, const BoxView& boxes,
                        const ObjectTable<BoundType<Box>>& objects, Threads threads)
    : ids_(ids),
      boxes_(boxes),
      threads_(std::move(threads)),
      changed_(std::make_unique_for_overwrite<std::uint32_t[]>(ids.size())),  // NOLINT: as declared
      counts_(parts_of(ids.size())) {
  LowestFound unknown(ids_.size());
  LowestFound nan(ids_.size());
  std::atomic<bool> any_empty = false;
  std::atomic<bool> ascend = true;
  for_each_part(ids_.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    BoxReader<Box>(boxes_).for_each(begin, end, [&](std::size_t k, const Box& box) {
      if (!objects.contains(ids_[k])) unknown.add(k);
      if (k > 0 && ids_[k] <= ids_[k - 1]) ascend = false;
      if (is_proper(box)) return;
      any_empty = true;
      if (has_nan(box)) nan.add(k);
    });
  });
  if (unknown.any()) objects.refuse_unknown(ids_[unknown.get()]);
  if (nan.any()) throw_nan("box " + std::to_string(nan.get()));
  any_empty_ = any_empty;
  if (!ascend) threads_ = 1;  // an id may be there twice
}

template <class Box>
void BoxMoves<Box>::store(std::span<Box> boxes) noexcept {
  for_each_part(ids_.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    std::uint32_t* const changed = changed_.get() + begin;
    std::size_t count = 0;
    for_each(begin, end, [&](std::uint32_t id, const Box& box) {
      changed[count] = id;
      count += static_cast<std::size_t>(!same_bits(boxes[id], box));
      boxes[id] = box;
    });
    counts_[begin / boxes_per_part] = count;
  });
}

template <class Box>
std::size_t BoxMoves<Box>::changed_count() const noexcept {
  return std::accumulate(counts_.begin(), counts_.end(), std::size_t{0});
}

template class BoxMoves<Aabb>;
template class BoxMoves<Aabb64>;

}  // namespace broadcl
