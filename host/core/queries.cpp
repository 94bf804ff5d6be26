#include "core/queries.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>

#include <broadcl/error.hpp>

#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/free_lists.hpp"
#include "base/lanes.hpp"
#include "base/packed_boxes.hpp"
#include "base/parallel.hpp"
#include "base/system.hpp"
#include "core/exact_reaches.hpp"
#include "core/reach.hpp"
#include "engines/box_tree.hpp"

namespace broadcl {
namespace {

/// The tree reads a box in the time in which so many are tested one by one.
constexpr std::size_t tests_per_read = 4;

/// Some queries, which are searched for in tiles.
template <class Box>
class TiledQueries {
 public:
  TiledQueries(const Searched<Box>& in, std::span<const Box> queries, const QueryOptions& options)
      : in_(in), queries_(queries), rules_(in.core, options) {
    refuse_options(options, queries.size());
    const DefaultFloatingPoint as_everywhere;
    within_ = rounded_to<Bound>(options.within.value_or(0));
    convert();
  }

  [[nodiscard]] std::span<const Aabb> images() const noexcept { return images_; }

  /// Finds the hits of a tile of queries, in any order.
  /// @param indices Of the queries.
  [[gnu::noinline]] void find(std::span<const std::uint32_t> indices, HitList& hits) const {
    const DefaultFloatingPoint as_everywhere;
    hits.clear();
    if (in_.tree != nullptr) {
      std::array<QueryBox, BoxTree::most_queries> tile;
      for (std::size_t k = 0; k < indices.size(); ++k) {
        tile[k] = {
            .box = images_[indices[k]], .reach = reach_of(indices[k]), .world = rules_.world_of(indices[k])};
      }
      in_.tree->find(std::span(tile).first(indices.size()), hits);
      keep(indices, hits);
    }
    for (std::uint32_t k = 0; k < indices.size(); ++k) {
      const std::uint32_t end = in_.tree == nullptr ? static_cast<std::uint32_t>(in_.slots) : 0;
      for (std::uint32_t id = 0; id < end; ++id) test(indices, k, id, hits);
      for (const std::uint32_t id : in_.unread) test(indices, k, id, hits);
    }
  }

 private:
  using Bound = BoundType<Box>;

  /// That of the image of a query. (Its box was grown in double precision.)
  [[nodiscard]] float reach_of(std::uint32_t query) const noexcept {
    if constexpr (is_exact) {
      return in_.core.reaches().empty() ? 0 : reach_of_image(images_[query], 0);
    } else {
      return within_;
    }
  }

  [[nodiscard]] bool is_near(std::uint32_t query, std::uint32_t id) const noexcept {
    const std::span<const Bound> reaches = in_.core.reaches();
    return is_within(queries_[query], in_.core.packed_box(id), within_ + (reaches.empty() ? 0 : reaches[id]));
  }

  /// Removes the hits of unread boxes, and those that float32 or the options make wrong.
  void keep(std::span<const std::uint32_t> indices, HitList& hits) const {
    if (!is_exact && in_.unread.empty() && rules_.accept_all()) return;
    const auto is_wrong = [&](const Hit& hit) {
      return in_.unread_set.contains(hit.slot) || !rules_.accept(indices[hit.query], hit.slot) ||
             (is_exact && !is_near(indices[hit.query], hit.slot));
    };
    const std::span<Hit> found = hits.get();
    hits.set_end(std::to_address(std::remove_if(found.begin(), found.end(), is_wrong)));
  }

  void test(std::span<const std::uint32_t> indices, std::uint32_t k, std::uint32_t id, HitList& hits) const {
    if (!is_near(indices[k], id) || !rules_.accept(indices[k], id)) return;
    Hit* const next = hits.reserve(1);
    *next = {k, id};
    hits.set_end(next + 1);
  }

  /// Finds the images of the queries.
  void convert() {
    if constexpr (is_exact) {
      converted_.resize(queries_.size());
      for_each_part(queries_.size(), in_.threads,
                    [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
                      const DefaultFloatingPoint as_everywhere;
                      for (std::size_t k = begin; k < end; ++k)
                        converted_[k] = in_.core.image_of(grown(queries_[k], within_));
                    });
      images_ = converted_;
    } else {
      images_ = queries_;
    }
  }

  static constexpr bool is_exact = std::is_same_v<Box, Aabb64>;

  const Searched<Box>& in_;
  std::span<const Box> queries_;
  QueryRules<Box> rules_;
  Bound within_ = 0;
  std::vector<Aabb> converted_;
  std::span<const Aabb> images_;
};

/// Sorts slots: a few by counting for each how many are less.
void sort_slots(std::span<std::uint32_t> slots) {
  using Lanes = decltype(FourLanes{} <= FourLanes{});
  constexpr std::size_t lanes = sizeof(Lanes) / sizeof(std::int32_t);
  constexpr std::size_t most_counted = 128;
  if (slots.size() > most_counted) {
    std::ranges::sort(slots);
    return;
  }
  std::array<std::int32_t, most_counted> all;
  const std::size_t n = slots.size();
  std::ranges::copy(slots, all.begin());
  std::fill(all.begin() + static_cast<std::ptrdiff_t>(n),
            all.begin() + static_cast<std::ptrdiff_t>((n + lanes - 1) / lanes * lanes),
            std::numeric_limits<std::int32_t>::max());
  for (std::size_t k = 0; k < n; ++k) {
    Lanes before{};
    for (std::size_t first = 0; first < n; first += lanes) {
      Lanes others;
      std::memcpy(&others, &all[first], sizeof others);
      before -= others < all[k];
    }
    const std::int32_t rank = before[0] + before[1] + before[2] + before[3];
    slots[static_cast<std::size_t>(rank)] = static_cast<std::uint32_t>(all[k]);
  }
}

/// Appends the slots that each query of a tile found, in ascending order, but not more than its limit.
/// @param counts Receives how many these are.
void append_slots(std::span<const Hit> hits, std::uint32_t limit,
                  std::span<std::uint32_t, BoxTree::most_queries> counts, std::vector<std::uint32_t>& slots) {
  std::array<std::size_t, BoxTree::most_queries + 1> ends{};
  for (const Hit& hit : hits) ++ends.at(hit.query + 1);
  const std::size_t first = slots.size();
  ends[0] = first;
  for (std::size_t k = 0; k < counts.size(); ++k) ends.at(k + 1) += ends.at(k);
  slots.resize(first + hits.size());
  const auto starts = ends;
  for (const Hit& hit : hits) slots[ends.at(hit.query)++] = hit.slot;
  std::uint32_t* next = slots.data() + first;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    const std::span<std::uint32_t> own = std::span(slots).subspan(starts.at(k), ends.at(k) - starts.at(k));
    sort_slots(own);
    counts[k] = static_cast<std::uint32_t>(std::min<std::size_t>(own.size(), limit));
    next = std::ranges::copy(own.first(counts[k]), next).out;
  }
  slots.resize(static_cast<std::size_t>(next - slots.data()));
}

/// The hits of queries, which are packed.
template <class Box>
Hits search(const Searched<Box>& in, std::span<const Box> queries, const QueryOptions& options) {
  const TiledQueries<Box> search(in, queries, options);
  return collect_hits(search.images(), options, in.threads,
                      [&](std::span<const std::uint32_t> tile, FoundHits& found) {
                        search.find(tile, found.hits);
                        append_slots(found.hits.get(), options.limit, found.counts, found.slots);
                      });
}

/// The same for one. If this throws, the ids are as before.
template <class Box>
std::size_t search(const Searched<Box>& in, const Box& query, const QueryOptions& options,
                   std::vector<std::uint32_t>& ids) {
  const TiledQueries<Box> search(in, std::span(&query, 1), options);
  HitList hits;
  constexpr std::array<std::uint32_t, 1> only{0};
  search.find(only, hits);
  const std::span<Hit> found = hits.get();
  const std::size_t count = std::min<std::size_t>(found.size(), options.limit);
  if (count > options.most_hits) throw_too_many_hits(options.most_hits);
  ids.resize(options.count_only ? 0 : found.size());
  if (options.count_only) return count;
  std::ranges::transform(found, ids.begin(), &Hit::slot);
  sort_slots(ids);
  ids.resize(count);
  return count;
}

}  // namespace

template <class Box>
Hits Queries<Box>::overlapping(const BoxView& boxes, const QueryOptions& options) {
  refuse_options(options, boxes.size());
  const std::vector<Box> packed = packed_boxes<Box>(boxes, threads_);
  return answer(packed.size(),
                [&](const Searched<Box>& in) { return search(in, std::span<const Box>(packed), options); });
}

/// Calls a function with what many queries are to search.
template <class Box>
Hits Queries<Box>::answer(std::size_t queries, const std::function<Hits(const Searched<Box>&)>& search) {
  return with_current(queries, [&](const Searched<Box>& in) {
    if (queries * unread_count() <= tests_per_read * slots_) return search(in);
    // (The tree cannot read anything now.)
    Core<Box> copy(make_sweep_and_prune(threads_), threads_);
    core_.copy_to(copy, slots_);
    return Queries(copy, threads_).answer(queries, search);
  });
}

template <class Box>
std::size_t Queries<Box>::overlapping(const Box& box, std::vector<std::uint32_t>& ids,
                                      const QueryOptions& options) {
  if (has_nan(box)) throw_nan("the box");
  return with_current(1, [&](const Searched<Box>& in) { return search(in, pack(box), options, ids); });
}

/// Calls a function with what is to be searched.
template <class Box>
template <class Function>
auto Queries<Box>::with_current(std::size_t queries, const Function& function) {
  core_.refuse_forked();
  std::shared_lock shared(mutex_);
  while (!is_current_ || must_read(queries)) {
    shared.unlock();
    {
      const std::unique_lock unique(mutex_);
      if (!is_current_ || must_read(queries)) find_unread(queries);
    }
    shared.lock();
  }
  const bool all = !unread_;
  scanned_.fetch_add(queries * unread_count(), std::memory_order_relaxed);
  return function(Searched<Box>{.core = core_,
                                .slots = slots_,
                                .tree = all ? nullptr : tree_,
                                .unread = all ? std::span<const std::uint32_t>() : *unread_,
                                .unread_set = unread_set_,
                                .threads = threads_});
}

/// Whether testing what is not in the tree would have taken as long as reading it.
template <class Box>
bool Queries<Box>::must_read(std::size_t queries) const noexcept {
  const std::size_t unread = unread_count();
  return unread > 0 && scanned_ + queries * unread > tests_per_read * unread && core_.can_read();
}

/// Finds what is not in the tree, and reads it if it is time.
template <class Box>
void Queries<Box>::find_unread(std::size_t queries) {
  is_current_ = false;  // until all is done
  slots_ = core_.slots();
  tree_ = &core_.choose_tree();
  unread_ = core_.unread();
  if (must_read(queries)) {
    core_.read();
    scanned_ = 0;
    unread_.emplace();
  }
  unread_set_ = SlotSet(unread_ ? *unread_ : std::span<const std::uint32_t>());
  is_current_ = true;
}

template <class Box>
void Queries<Box>::prepare_begin() {
  if (!std::exchange(are_asked_in_flight_, false)) return;
  (void)core_.choose_tree();
  if (core_.count_unread() > 0 && core_.can_read()) core_.read();
}

/// Reads all boxes if testing all of them would have taken as long as reading those that are not in the tree.
template <class Box>
bool Queries<Box>::read_all() {
  core_.refuse_forked();
  const std::unique_lock unique(mutex_);
  if (has_all_) return true;
  is_current_ = false;
  slots_ = core_.slots();
  tree_ = &core_.choose_tree();
  if (const std::size_t unread = core_.count_unread(); unread > 0 || !tree_->is_ready()) {
    scanned_ += slots_;
    if (scanned_ <= tests_per_read * unread || !core_.can_read()) return false;
    core_.read();
    scanned_ = 0;
  }
  return has_all_ = true;
}

template <class Box>
std::vector<std::uint32_t> Queries<Box>::partners(std::uint32_t id) {
  (void)core_.filter(id);  // refuses unknown ids
  std::shared_lock shared(mutex_);
  while (!has_pairs_) {
    shared.unlock();
    {
      const std::unique_lock unique(mutex_);
      if (!has_pairs_) index_pairs();
    }
    shared.lock();
  }
  std::vector<std::uint32_t> partners;
  for (auto pair = std::ranges::lower_bound(pairs_, id, {}, &Pair::b); pair != pairs_.end() && pair->b == id;
       ++pair) {
    partners.push_back(pair->a);
  }
  if (id + std::size_t{2} < first_larger_.size()) {
    partners.insert(partners.end(), larger_.begin() + first_larger_[id + std::size_t{1}],
                    larger_.begin() + first_larger_[id + std::size_t{2}]);
  }
  return partners;
}

/// Lists the larger partners of each id. (The smaller ones are together in the list of pairs.)
template <class Box>
void Queries<Box>::index_pairs() {
  pairs_ = core_.pairs();
  first_larger_.assign(pairs_.empty() ? 0 : pairs_.back().b + std::size_t{2}, 0);
  larger_.resize(pairs_.size());
  for (const Pair& pair : pairs_) ++first_larger_[pair.a + std::size_t{1}];
  std::partial_sum(first_larger_.begin(), first_larger_.end(), first_larger_.begin());
  for (std::size_t k = pairs_.size(); k-- > 0;)
    larger_[--first_larger_[pairs_[k].a + std::size_t{1}]] = pairs_[k].b;
  has_pairs_ = true;
}

template <class Box>
void Queries<Box>::shrink() noexcept {
  forget_pairs();
  unread_.reset();
  free_lists(pairs_, first_larger_, larger_);
}

template class Queries<Aabb>;
template class Queries<Aabb64>;

}  // namespace broadcl
