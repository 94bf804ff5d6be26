#include "mpi/pending_changes.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <tuple>

namespace broadcl::mpi {
namespace {

struct Event {
  Pair pair;
  std::size_t update;
  bool is_added;  // An update first removes a pair, then adds it again.
};

/// By pair, then in the order in which they happened.
std::vector<Event> events_of(Updates updates) {
  std::vector<Event> events;
  for (std::size_t k = 0; k < updates.size(); ++k) {
    for (const Pair& pair : updates[k].removed) events.push_back({pair, k, false});
    for (const Pair& pair : updates[k].added) events.push_back({pair, k, true});
  }
  std::ranges::sort(events, [](const Event& s, const Event& t) {
    return std::tie(s.pair, s.update, s.is_added) < std::tie(t.pair, t.update, t.is_added);
  });
  return events;
}

/// Calls function(events) for the events of each pair.
template <class Function>
void for_each_pair(std::span<const Event> events, const Function& function) {
  while (!events.empty()) {
    const auto is_other = [&](const Event& event) { return event.pair != events.front().pair; };
    const auto end = std::ranges::find_if(events, is_other);
    const auto count = static_cast<std::size_t>(end - events.begin());
    function(events.first(count));
    events = events.subspan(count);
  }
}

}  // namespace

PairLists combined(Updates updates, std::span<const std::uint32_t> recycled) {
  const auto is_recycled = [&](std::uint32_t id) { return std::ranges::binary_search(recycled, id); };
  PairLists lists;
  for_each_pair(events_of(updates), [&](std::span<const Event> events) {
    const Pair pair = events.front().pair;
    const bool was_there = !events.front().is_added;
    const bool is_there = events.back().is_added;
    if (was_there && is_there && !is_recycled(pair.a) && !is_recycled(pair.b)) return;
    if (was_there) lists.removed.push_back(pair);
    if (is_there) lists.added.push_back(pair);
  });
  return lists;
}

std::vector<Pair> undone(Updates updates, std::span<const Pair> pairs) {
  PairLists lists;
  for_each_pair(events_of(updates), [&](std::span<const Event> events) {
    (events.front().is_added ? lists.added : lists.removed).push_back(events.front().pair);
  });
  std::vector<Pair> before;
  std::vector<Pair> rest;
  std::ranges::set_difference(pairs, lists.added, std::back_inserter(rest));
  std::ranges::set_union(rest, lists.removed, std::back_inserter(before));
  return before;
}

}  // namespace broadcl::mpi
