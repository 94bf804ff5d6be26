#include "core/box_moves.hpp"

#include <algorithm>
#include <atomic>
#include <string>

#include "core/copy_threads.hpp"

namespace broadcl {

BoxMoves::BoxMoves(std::span<const std::uint32_t> ids, const BoxView& boxes, const ObjectTable& objects,
                   std::size_t threads)
    : ids_(ids),
      boxes_(boxes),
      threads_(copy_threads(ids.size(), threads)),
      changed_(std::make_unique_for_overwrite<std::uint32_t[]>(ids.size())),  // NOLINT: as declared
      counts_((ids.size() + part - 1) / part) {
  std::atomic<std::size_t> first_unknown = ids_.size();
  std::atomic<std::size_t> first_nan = ids_.size();
  std::atomic<bool> any_empty = false;
  std::atomic<bool> ascend = true;
  for_each_part([&](std::size_t begin, std::size_t end) {
    bool is_any_empty = false;
    BoxReader(boxes_).for_each(begin, end, [&](std::size_t k, const Aabb& box) {
      if (!objects.contains(ids_[k])) lower(first_unknown, k);
      if (k > 0 && ids_[k] <= ids_[k - 1]) ascend = false;
      if (is_proper(box)) return;
      is_any_empty = true;
      if (has_nan(box)) lower(first_nan, k);
    });
    if (is_any_empty) any_empty = true;
  });
  if (first_unknown < ids_.size()) objects.refuse_unknown(ids_[first_unknown]);
  if (first_nan < ids_.size()) throw_nan("box " + std::to_string(first_nan));
  any_empty_ = any_empty;
  if (!ascend) threads_ = 1;  // an id may be there twice
}

template <class Function>
void BoxMoves::for_each_part(const Function& function) const {
  parallel_for(counts_.size(), threads_, [&](std::size_t k, std::size_t /*thread*/) {
    function(k * part, std::min(ids_.size(), (k + 1) * part));
  });
}

void BoxMoves::store(std::span<Aabb> boxes) noexcept {
  for_each_part([&](std::size_t begin, std::size_t end) {
    std::uint32_t* const changed = changed_.get() + begin;
    std::size_t count = 0;
    for_each(begin, end, [&](std::uint32_t id, const Aabb& box) {
      changed[count] = id;
      count += static_cast<std::size_t>(!same_bits(boxes[id], box));
      boxes[id] = box;
    });
    counts_[begin / part] = count;
  });
}

std::size_t BoxMoves::changed_count() const noexcept {
  std::size_t count = 0;
  for (const std::size_t of_part : counts_) count += of_part;
  return count;
}

}  // namespace broadcl
