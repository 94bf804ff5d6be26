#include "mpi/halos.hpp"

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>

#include "base/box_parts.hpp"
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

void Halo::resize(std::size_t count) {
  ids.resize(count);
  boxes.resize(count);
  filters.resize(count);
}

void HaloChanges::write(std::span<const HaloChanges> parts, Bytes& message) {
  Header header{};
  std::size_t bytes = sizeof header;
  for (const HaloChanges& part : parts) {
    header.exclusions += part.exclusions.size();
    header.left += part.left.size();
    header.entered += part.entered.size();
    header.moved += part.moved.size();
    header.refiltered += part.refiltered.size();
    if (part.has_exclusions) header.has_exclusions = 1;
    bytes += part.exclusions.size_bytes() + part.left.size_bytes() + part.entered.size_bytes() +
             part.entered_boxes.size_bytes() + part.entered_filters.size_bytes() + part.moved.size_bytes() +
             part.moved_boxes.size_bytes() + part.refiltered.size_bytes() + part.new_filters.size_bytes();
  }
  if (bytes == sizeof header && header.has_exclusions == 0) return message.resize(0);
  message.resize(bytes);
  Cursor cursor(message.data());
  cursor.copy(std::span<const Header>(&header, 1));
  const auto copy = [&](auto array) {
    for (const HaloChanges& part : parts) cursor.copy(part.*array);
  };
  copy(&HaloChanges::exclusions);
  copy(&HaloChanges::left);
  copy(&HaloChanges::entered);
  copy(&HaloChanges::entered_boxes);
  copy(&HaloChanges::entered_filters);
  copy(&HaloChanges::moved);
  copy(&HaloChanges::moved_boxes);
  copy(&HaloChanges::refiltered);
  copy(&HaloChanges::new_filters);
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

void HaloHistory::Part::clear() noexcept {
  left.clear();
  moved.clear();
  moved_boxes.clear();
  refiltered.clear();
  new_filters.clear();
  entered.clear();
}

HaloChanges HaloHistory::Part::changes() const {
  return {.left = left,
          .entered = entered.ids,
          .entered_boxes = entered.boxes,
          .entered_filters = entered.filters,
          .moved = moved,
          .moved_boxes = moved_boxes,
          .refiltered = refiltered,
          .new_filters = new_filters};
}

/// Compares a part of the new halo, and what the last one had up to the next part.
void HaloHistory::compare(std::size_t part, std::span<const std::uint32_t> recycled) {
  const std::size_t begin = part * boxes_per_part;
  const bool is_end = begin + boxes_per_part >= next_.ids.size();
  const std::size_t end = is_end ? next_.ids.size() : begin + boxes_per_part;
  const auto position_in_last = [&](std::size_t position) {
    const auto found = std::ranges::lower_bound(last_.ids, next_.ids[position]);
    return static_cast<std::uint32_t>(found - last_.ids.begin());
  };
  std::uint32_t before = part == 0 ? 0 : position_in_last(begin);
  const std::size_t before_end = is_end ? last_.ids.size() : position_in_last(end);
  Part& changes = parts_[part];
  const auto leave_below = [&](std::uint64_t id) {
    for (; before < before_end && last_.ids[before] < id; ++before) changes.left.push_back(before);
  };
  for (auto now = static_cast<std::uint32_t>(begin); now < end; ++now) {
    const std::uint32_t id = next_.ids[now];
    const bool is_other = !recycled.empty() && std::ranges::binary_search(recycled, id);
    leave_below(id + std::uint64_t{is_other});
    if (is_other || before == before_end || last_.ids[before] != id) {
      changes.entered.add(id, next_.boxes[now], next_.filters[now]);
      continue;
    }
    if (!same_bits(last_.boxes[before], next_.boxes[now])) {
      changes.moved.push_back(now);
      changes.moved_boxes.push_back(next_.boxes[now]);
    }
    if (last_.filters[before] != next_.filters[now]) {
      changes.refiltered.push_back(now);
      changes.new_filters.push_back(next_.filters[now]);
    }
    ++before;
  }
  leave_below(std::uint64_t{1} << 32U);
}

void HaloHistory::write(std::span<const std::uint32_t> recycled, const HaloChanges& exclusions,
                        const Threads& threads, Bytes& message) {
  const std::size_t objects = next_.ids.size();
  const std::size_t count = is_new_ ? std::max<std::size_t>(1, parts_of(objects)) : 0;
  if (parts_.size() < count) parts_.resize(count);
  parallel_for(count, useful_threads(objects, 2 * boxes_per_part, threads),
               [&](std::size_t part, std::size_t /*thread*/) {
                 parts_[part].clear();
                 compare(part, recycled);
               });
  std::vector<HaloChanges> changes{exclusions};
  for (const Part& part : std::span(parts_).first(count)) changes.push_back(part.changes());
  HaloChanges::write(changes, message);
}

void HaloHistory::write_last(Bytes& message) const {
  const HaloChanges all{.entered = last_.ids, .entered_boxes = last_.boxes, .entered_filters = last_.filters};
  HaloChanges::write(std::span(&all, 1), message);
}

void HaloHistory::commit() noexcept {
  if (std::exchange(is_new_, false)) std::swap(last_, next_);
}

}  // namespace broadcl::mpi
