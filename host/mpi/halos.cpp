#include "mpi/halos.hpp"

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>

#include "base/packed_box.hpp"

namespace broadcl::mpi {
namespace {

/// Lengths of the arrays of a message, which follow one after the other.
struct Header {
  std::uint64_t exclusions, left, entered, moved, refiltered, has_exclusions;
};

/// Reads or writes a message array by array.
template <class Byte>
class Cursor {
 public:
  explicit Cursor(Byte* next) : next_(next) {}

  template <class Value>
  void copy(std::span<const Value> values) {
    if (!values.empty()) std::memcpy(next_, values.data(), values.size_bytes());
    next_ += values.size_bytes();
  }
  template <class Value>
  void view(std::uint64_t count, std::span<const Value>& values) {
    static_assert(std::is_trivially_copyable_v<Value>);
    values = {reinterpret_cast<const Value*>(next_), count};
    next_ += values.size_bytes();
  }

 private:
  Byte* next_;
};

}  // namespace

void Halo::clear() noexcept {
  ids.clear();
  boxes.clear();
  filters.clear();
}

void Halo::add(std::uint32_t id, const Aabb& box, const Filter& filter) {
  ids.push_back(id);
  boxes.push_back(box);
  filters.push_back(filter);
}

void HaloChanges::write(Bytes& message) const {
  const Header header{exclusions.size(), left.size(),       entered.size(),
                      moved.size(),      refiltered.size(), has_exclusions ? 1U : 0U};
  const bool is_empty = left.empty() && entered.empty() && moved.empty() && refiltered.empty();
  if (is_empty && !has_exclusions) return message.resize(0);
  message.resize(sizeof header + exclusions.size_bytes() + left.size_bytes() + entered.size_bytes() +
                 entered_boxes.size_bytes() + entered_filters.size_bytes() + moved.size_bytes() +
                 moved_boxes.size_bytes() + refiltered.size_bytes() + new_filters.size_bytes());
  Cursor cursor(message.data());
  cursor.copy(std::span(&header, 1));
  cursor.copy(exclusions);
  cursor.copy(left);
  cursor.copy(entered);
  cursor.copy(entered_boxes);
  cursor.copy(entered_filters);
  cursor.copy(moved);
  cursor.copy(moved_boxes);
  cursor.copy(refiltered);
  cursor.copy(new_filters);
}

HaloChanges HaloChanges::read(const Bytes& message) {
  HaloChanges changes;
  if (message.size() == 0) return changes;
  Cursor cursor(message.data());
  std::span<const Header> header;
  cursor.view(1, header);
  const auto& [exclusions, left, entered, moved, refiltered, has_exclusions] = header.front();
  changes.has_exclusions = has_exclusions != 0;
  cursor.view(exclusions, changes.exclusions);
  cursor.view(left, changes.left);
  cursor.view(entered, changes.entered);
  cursor.view(entered, changes.entered_boxes);
  cursor.view(entered, changes.entered_filters);
  cursor.view(moved, changes.moved);
  cursor.view(moved, changes.moved_boxes);
  cursor.view(refiltered, changes.refiltered);
  cursor.view(refiltered, changes.new_filters);
  return changes;
}

void HaloHistory::renew(Halo& near, bool all, std::span<const std::uint32_t> changed) {
  const auto was_here = [&](std::uint32_t id) { return std::ranges::binary_search(last_.ids, id); };
  is_new_ = all || !near.ids.empty() || std::ranges::any_of(changed, was_here);
  if (!is_new_) return;
  if (all) return std::swap(next_, near);
  next_.clear();
  std::size_t other = 0;  // position in near
  const auto add_below = [&](std::uint64_t id) {
    for (; other < near.ids.size() && near.ids[other] < id; ++other) {
      next_.add(near.ids[other], near.boxes[other], near.filters[other]);
    }
  };
  for (std::size_t k = 0; k < last_.ids.size(); ++k) {
    if (std::ranges::binary_search(changed, last_.ids[k])) continue;
    add_below(last_.ids[k]);
    next_.add(last_.ids[k], last_.boxes[k], last_.filters[k]);
  }
  add_below(std::uint64_t{1} << 32U);
}

void HaloHistory::write(std::span<const std::uint32_t> recycled, HaloChanges changes, Bytes& message) {
  left_.clear();
  moved_.clear();
  moved_boxes_.clear();
  refiltered_.clear();
  new_filters_.clear();
  entered_.clear();
  std::uint32_t before = 0;  // position in last_
  const auto leave_below = [&](std::uint64_t id) {
    for (; before < last_.ids.size() && last_.ids[before] < id; ++before) left_.push_back(before);
  };
  for (std::uint32_t now = 0; is_new_ && now < next_.ids.size(); ++now) {
    const std::uint32_t id = next_.ids[now];
    const bool is_other = !recycled.empty() && std::ranges::binary_search(recycled, id);
    leave_below(id + std::uint64_t{is_other});
    if (is_other || before == last_.ids.size() || last_.ids[before] != id) {
      entered_.add(id, next_.boxes[now], next_.filters[now]);
      continue;
    }
    if (!same_bits(last_.boxes[before], next_.boxes[now])) {
      moved_.push_back(now);
      moved_boxes_.push_back(next_.boxes[now]);
    }
    if (last_.filters[before] != next_.filters[now]) {
      refiltered_.push_back(now);
      new_filters_.push_back(next_.filters[now]);
    }
    ++before;
  }
  if (is_new_) leave_below(std::uint64_t{1} << 32U);
  changes.left = left_;
  changes.entered = entered_.ids;
  changes.entered_boxes = entered_.boxes;
  changes.entered_filters = entered_.filters;
  changes.moved = moved_;
  changes.moved_boxes = moved_boxes_;
  changes.refiltered = refiltered_;
  changes.new_filters = new_filters_;
  changes.write(message);
}

void HaloHistory::write_last(Bytes& message) const {
  HaloChanges changes;
  changes.entered = last_.ids;
  changes.entered_boxes = last_.boxes;
  changes.entered_filters = last_.filters;
  changes.write(message);
}

void HaloHistory::commit() noexcept {
  if (std::exchange(is_new_, false)) std::swap(last_, next_);
}

}  // namespace broadcl::mpi
