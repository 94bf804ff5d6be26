#include "mpi/objects.hpp"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

#include "base/packed_box.hpp"

namespace broadcl::mpi {
namespace {

constexpr std::size_t most_objects = std::size_t{1} << 30U;
constexpr std::size_t boxes_per_part = std::size_t{1} << 16U;

void refuse_nan(const Aabb& box) {
  if (has_nan(box)) throw_nan("a box");
}

/// @param nans Whether boxes with a NaN are copied, too.
void copy_boxes(std::span<const Aabb> from, std::span<Aabb> to, bool nans) {
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (nans || !has_nan(from[k])) to[k] = from[k];
  }
}

/// The same for boxes that are not read again soon: bypasses the caches, if possible, which would first load
/// the memory that is overwritten.
void stream_boxes(std::span<const Aabb> from, std::span<Aabb> to, bool nans) {
  std::size_t copied = 0;
#if defined(__SSE2__)
  const bool is_aligned = reinterpret_cast<std::uintptr_t>(to.data()) % sizeof(__m128) == 0;
  for (; is_aligned && copied + 1 < from.size(); copied += 2) {
    const float* source = from[copied].lower.data();
    const __m128 s = _mm_loadu_ps(source);
    const __m128 t = _mm_loadu_ps(source + 4);
    const __m128 u = _mm_loadu_ps(source + 8);
    const __m128 is_nan = _mm_or_ps(_mm_cmpunord_ps(s, t), _mm_cmpunord_ps(u, u));
    if (!nans && _mm_movemask_ps(is_nan) != 0) {
      copy_boxes(from.subspan(copied, 2), to.subspan(copied, 2), false);
      continue;
    }
    float* target = to[copied].lower.data();
    _mm_stream_ps(target, s);
    _mm_stream_ps(target + 4, t);
    _mm_stream_ps(target + 8, u);
  }
  _mm_sfence();
#endif
  copy_boxes(from.subspan(copied), to.subspan(copied), nans);
}

}  // namespace

std::uint32_t Objects::add(const Aabb& box, const Filter& filter) {
  refuse_nan(box);
  const bool is_new = free_.empty();
  const auto id = is_new ? static_cast<std::uint32_t>(ids()) : free_.front();
  reserve(ids() + (is_new ? 1 : 0));
  // Nothing below throws.
  settle();
  if (is_new) {
    grow(ids() + 1);
  } else {
    std::ranges::pop_heap(free_, std::greater<>());
    free_.pop_back();
  }
  give(id, true);
  now_[id] = box;
  store_filter(id, filter);
  return id;
}

void Objects::move(std::uint32_t id, const Aabb& box) {
  refuse_unknown(id);
  refuse_nan(box);
  settle();
  now_[id] = box;
  changes_.insert(id);
}

void Objects::set_filter(std::uint32_t id, const Filter& filter) {
  refuse_unknown(id);
  settle();
  store_filter(id, filter);
}

void Objects::remove(std::uint32_t id) {
  refuse_unknown(id);
  // Nothing below throws.
  settle();
  give(id, false);
  std::ranges::push_heap(free_, std::greater<>());
}

std::span<Aabb> Objects::map(std::size_t n) {
  reserve(std::max(n, ids()));
  // Nothing below throws.
  settle();
  if (n > ids()) grow(n);
  free_.clear();
  for (auto id = static_cast<std::uint32_t>(n); id < ids(); ++id) {
    if (is_live_[id] != 0) {
      give(id, false);
    } else {
      free_.push_back(id);
    }
  }
  for (std::uint32_t id = 0; size_ < n; ++id) {
    if (is_live_[id] != 0) continue;
    give(id, true);
    store_filter(id, Filter());
  }
  changes_.all = true;
  return std::span(now_).first(n);
}

void Objects::lend() noexcept {
  are_lent_ = true;
  are_packed_ = is_now_last_ = false;
  changes_.all = true;
}

void Objects::take_back(std::span<const Aabb> boxes) noexcept {
  if (!are_lent_) return;
  workers_.for_each_part(ids(), boxes_per_part, [&](std::size_t begin, std::size_t end) {
    stream_boxes(boxes.subspan(begin, end - begin), std::span(now_).subspan(begin, end - begin),
                 !are_packed_);
  });
  are_lent_ = false;
}

void Objects::commit() noexcept {
  if (changes_.all) {
    std::swap(last_, now_);
    is_now_last_ = true;
  }
  for (const std::uint32_t id : changes_.changed()) {
    if (!is_now_last_) last_[id] = now_[id];
    last_filters_[id] = filters_[id];
  }
  changes_.clear();
  last_size_ = size_;
}

/// Brings now_ up to date.
void Objects::settle() noexcept {
  if (!is_now_last_) return;
  workers_.for_each_part(ids(), boxes_per_part, [&](std::size_t begin, std::size_t end) {
    std::ranges::copy(std::span<const Aabb>(last_).subspan(begin, end - begin),
                      std::span(now_).subspan(begin).begin());
  });
  is_now_last_ = false;
}

void Objects::reserve(std::size_t ids) {
  if (ids > most_objects)
    throw Error::invalid_argument("more than 1073741824 objects on a rank; use more ranks");
  if (ids <= capacity_) return;
  const std::size_t capacity = std::max(ids, capacity_ + capacity_ / 2);
  for (std::vector<Aabb>* boxes : {&now_, &last_}) boxes->reserve(capacity);
  for (std::vector<Filter>* filters : {&filters_, &last_filters_}) filters->reserve(capacity);
  free_.reserve(capacity);
  changes_.reserve(capacity);
  is_live_.reserve(capacity);
  capacity_ = capacity;
}

void Objects::grow(std::size_t ids) noexcept {
  for (std::vector<Aabb>* boxes : {&now_, &last_}) boxes->resize(ids, empty_aabb());
  for (std::vector<Filter>* filters : {&filters_, &last_filters_}) filters->resize(ids);
  is_live_.resize(ids, 0);
}

/// Records that an id gets an object, or loses it.
void Objects::give(std::uint32_t id, bool is_live) noexcept {
  is_live_[id] = is_live ? 1 : 0;
  size_ = is_live ? size_ + 1 : size_ - 1;
  now_[id] = empty_aabb();
  if (!is_live) free_.push_back(id);
  changes_.recycle(id);
}

void Objects::store_filter(std::uint32_t id, const Filter& filter) noexcept {
  if (filters_[id] == filter) return;
  filters_[id] = filter;
  any_filters_ = true;
  changes_.insert(id);
  changes_.filters = true;
}

void Objects::refuse_unknown(std::uint32_t id) const {
  if (id >= ids() || is_live_[id] == 0) {
    throw Error::invalid_argument("no object of this rank has the id " + std::to_string(id) +
                                  "; use the ids that add() returned");
  }
}

}  // namespace broadcl::mpi
