#include "engines/order_plan.hpp"

#include <algorithm>
#include <bit>
#include <utility>

namespace broadcl {

OrderPlan::OrderPlan(const Search& search)
    : slots(std::max<std::size_t>({1, search.last.slots, search.now.slots})),
      worlds(search.ordered_worlds),
      second_set(search.now.second_set),
      filters(search.now.filters),
      last_filters(search.last.filters) {}

void OrderPlan::set_buckets(bool one_per_slot) {
  const std::size_t slots_per_change = 2 * slots / std::max<std::size_t>(1, capacity);
  const bool is_shared = !one_per_slot && slots_per_change > 0;
  bucket_bits = is_shared ? static_cast<cl_uint>(std::bit_width(slots_per_change) - 1) : 0;
  buckets = worlds == 0 ? ((slots - 1) >> bucket_bits) + 1 : worlds + 1;
}

bool OrderPlan::fits(const PairDelta::Counts& counts) const noexcept {
  return std::max(counts.added, counts.removed) <= list_capacity &&
         counts.added + counts.removed <= capacity && !counts.is_unordered;
}

bool ChangeHistory::expects_more_than(std::size_t changes) const noexcept {
  return std::min(longest_, longest_before_) > changes;
}

void ChangeHistory::set_capacity(OrderPlan& plan, std::size_t most_sorted, std::size_t most) noexcept {
  const std::size_t wanted = plan.by_buckets ? changes_ + changes_ / 4 : 3 * std::min(longest_, most_sorted);
  // More memory only if it is wanted twice in a row.
  plan.capacity = std::max(OrderPlan::least_changes, std::min(wanted, std::max(wanted_, allocated_)));
  plan.capacity = std::min(plan.capacity, most);
  plan.list_capacity = plan.by_buckets ? plan.capacity : plan.capacity / 2;
  plan.expected =
      std::clamp(changes_ + changes_ / 8, std::min(OrderPlan::least_changes, plan.capacity), plan.capacity);
  wanted_ = wanted;
}

void ChangeHistory::commit(const PairDelta::Counts& counts) noexcept {
  changes_ = counts.added + counts.removed;
  allocated_ = std::max(allocated_, changes_);
  longest_before_ = std::exchange(longest_, std::max(counts.added, counts.removed));
}

}  // namespace broadcl
