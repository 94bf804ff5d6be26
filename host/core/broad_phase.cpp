#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "base/box_parts.hpp"
#include "base/box_reader.hpp"
#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/packed_boxes.hpp"
#include "core/core.hpp"
#include "core/exact_boxes.hpp"
#include "core/exclusions.hpp"
#include "core/queries.hpp"
#include "core/reach.hpp"
#include "core/recorder.hpp"
#include "core/tree_access.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {
namespace {

constexpr std::size_t most_in_search = std::size_t{1} << 31;

/// Does something such that its error names the set of boxes that it is about.
template <class Function>
auto naming(const std::string& set, const Function& function) {
  try {
    return function();
  } catch (const Error& error) {
    throw Error(set + error.what(), error.kind());
  }
}

template <class Box>
[[gnu::noinline]] void square_distances(BoxReader<Box> first, BoxReader<Box> second,
                                        std::span<const Pair> pairs, double* out) {
  for (const auto& [a, b] : pairs) {
    const Box& s = first.read(a, std::size_t{a} + 1).front();
    const Box& t = second.read(b, std::size_t{b} + 1).front();
    *out++ = is_proper(s) && is_proper(t) ? static_cast<double>(squared_distance(s, t))
                                          : std::numeric_limits<double>::infinity();
  }
}

/// An object and one of its labels.
struct Labelled {
  std::uint32_t label;
  std::uint32_t object;
};

/// The objects of pairs_that_share(), sorted by label; each occurs once for each of its labels.
std::vector<Labelled> by_label(std::span<const std::uint32_t> labels, std::size_t per_object) {
  if (per_object == 0 ? !labels.empty() : labels.size() % per_object != 0) {
    throw Error::invalid_argument(std::to_string(labels.size()) + " labels are not " +
                                  std::to_string(per_object) + " for each object; give as many for each");
  }
  if (per_object > 0 && labels.size() / per_object > most_in_search) {
    throw Error::invalid_argument("labels of more than 2147483648 objects; use fewer");
  }
  std::vector<Labelled> objects(labels.size());
  for (std::size_t k = 0; k < labels.size(); ++k) {
    objects[k] = {labels[k], static_cast<std::uint32_t>(k / per_object)};
  }
  std::ranges::sort(objects, {}, [](const Labelled& s) { return std::pair(s.label, s.object); });
  return objects;
}

/// In canonical order.
std::vector<Pair> each_once(std::vector<Pair> pairs) {
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

/// Makes the algorithm for a single search. On a device, `auto` would first compare the algorithms there,
/// which takes longer than any choice saves.
AlgorithmPointer make_for_one_search(Config config) {
  if (config.algorithm == "auto" && device_for(config)) config.algorithm = "tiles";
  return make_algorithm(config);
}

/// What a function finds with a broad phase of boxes that are searched once, for queries.
template <class Function>
Hits query_once(const BoxView& boxes, const BoxView& queries, Config config, const Function& function) {
  (void)find_algorithm(config.algorithm);
  config.algorithm = "sweep-and-prune";
  const auto find = [&](auto broad_phase) {
    (void)naming("the boxes: ", [&] { return broad_phase.add(boxes); });
    return naming("the queries: ", [&] { return function(broad_phase); });
  };
  return ExactBoxes::are_needed(boxes, queries) ? find(BroadPhase64(config)) : find(BroadPhase(config));
}

/// The pairs of one set, or of two, whose boxes follow each other then.
/// @param second Null for one set.
/// @param exclusions In canonical order.
std::vector<Pair> search_once(const BoxView& first, const BoxView* second, std::span<const Pair> exclusions,
                              const Config& config) {
  const bool sets = second != nullptr;
  const BoxView rest = sets ? *second : BoxView();
  const std::size_t boxes = first.size() + rest.size();
  const Threads threads(config);
  const auto algorithm = make_for_one_search(config);
  algorithm->reserve(boxes, sets);
  algorithm->reserve_exclusions(exclusions.size());
  const std::span<Aabb> packed = algorithm->boxes().first(boxes);
  std::vector<float> reaches;
  std::optional<ExactBoxes> exact;
  if (ExactBoxes::are_needed(first, rest)) {
    exact.emplace(first, rest, reach_for<double>(config), threads);
    if (const std::size_t nan = exact->pack_to(packed); nan < boxes) {
      const bool is_first = nan < first.size();
      throw_nan((sets ? is_first ? "the first set: box " : "the second set: box " : "box ") +
                std::to_string(is_first ? nan : nan - first.size()));
    }
    reaches = exact->reaches(packed);
  } else {
    reaches.assign(config.distance > 0 ? boxes : 0, reach_for<float>(config));
    pack_boxes(first, sets ? "the first set: " : "", threads, packed);
    pack_boxes(rest, "the second set: ", threads, packed.subspan(first.size()));
  }
  std::vector<Filter> filters(sets ? boxes : 0, Filter::second_set);
  if (sets) std::fill_n(filters.begin(), first.size(), Filter::first_set);
  std::vector<Pair> pairs = algorithm->find_all({.boxes = packed,
                                                 .changed = {.all = true},
                                                 .rules = {.filters = filters,
                                                           .exclusions = exclusions,
                                                           .reaches = reaches,
                                                           .all_changed = true,
                                                           .sets = sets,
                                                           .sets_decide = sets}});
  if (exact) exact->keep_pairs(pairs, algorithm->boxes(), reaches);
  return pairs;
}

}  // namespace

// (Without functions of its own, which would be exported.)
template <class Box>
struct BasicBroadPhase<Box>::Impl {
  Core<Box> core;
  const AlgorithmInfo& info;
  std::optional<Queries<Box>> queries{};
};

namespace {

/// The core, if objects are about to change.
template <class Impl>
auto& changing(Impl& impl) noexcept {
  impl->queries->forget_boxes();
  return impl->core;
}
/// The core, if the pairs may change, too.
template <class Impl>
auto& updating(Impl& impl) noexcept {
  impl->queries->forget_pairs();
  return impl->core;
}

/// What a function returns for all objects, in the order of their ids.
template <class Box, class Value>
auto of_all(const Core<Box>& core, Value (Core<Box>::*function)(std::uint32_t) const) {
  std::vector<std::remove_cvref_t<Value>> values;
  values.reserve(core.size());
  for (const std::uint32_t id : core.ids()) values.push_back((core.*function)(id));
  return values;
}

}  // namespace

template <class Box>
BasicBroadPhase<Box>::BasicBroadPhase() : BasicBroadPhase(Config()) {}

template <class Box>
BasicBroadPhase<Box>::BasicBroadPhase(const Config& config)
    : impl_(new Impl{Core<Box>(make_algorithm(config), Threads(config), reach_for<Bound>(config)),
                     find_algorithm(config.algorithm).info}) {
  impl_->queries.emplace(impl_->core, Threads(config));
  impl_->core.record_to(Recorder<Box>::make(config.distance));
}

template <class Box>
BasicBroadPhase<Box>::~BasicBroadPhase() = default;

template <class Box>
BasicBroadPhase<Box>::BasicBroadPhase(BasicBroadPhase&&) noexcept = default;

template <class Box>
BasicBroadPhase<Box>& BasicBroadPhase<Box>::operator=(BasicBroadPhase&&) noexcept = default;

template <class Box>
std::uint32_t BasicBroadPhase<Box>::add(const Box& box, const Filter& filter, Bound reach) {
  return changing(impl_).add(box, filter, reach);
}

template <class Box>
std::vector<std::uint32_t> BasicBroadPhase<Box>::add(const BoxView& boxes, std::span<const Filter> filters,
                                                     std::span<const Bound> reaches) {
  return changing(impl_).add(boxes, filters, reaches);
}

template <class Box>
std::vector<std::uint32_t> BasicBroadPhase<Box>::add(const BoxView& boxes, const Filter& filter) {
  return changing(impl_).add(boxes, {&filter, 1});
}

template <class Box>
void BasicBroadPhase<Box>::move(std::uint32_t id, const Box& box) {
  changing(impl_).move(id, box);
}

template <class Box>
void BasicBroadPhase<Box>::move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
  changing(impl_).move(ids, boxes);
}

template <class Box>
void BasicBroadPhase<Box>::set_filter(std::uint32_t id, const Filter& filter) {
  changing(impl_).set_filter(id, filter);
}

template <class Box>
void BasicBroadPhase<Box>::set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters) {
  changing(impl_).set_filters(ids, filters);
}

template <class Box>
void BasicBroadPhase<Box>::set_reach(std::span<const std::uint32_t> ids, std::span<const Bound> reaches) {
  changing(impl_).set_reach(ids, reaches);
}

template <class Box>
void BasicBroadPhase<Box>::set_exclusions(std::span<const Pair> pairs) {
  impl_->core.set_exclusions(pairs);
}

template <class Box>
void BasicBroadPhase<Box>::remove(std::uint32_t id) {
  changing(impl_).remove(id);
}

template <class Box>
void BasicBroadPhase<Box>::remove(std::span<const std::uint32_t> ids) {
  changing(impl_).remove(ids);
}

template <class Box>
bool BasicBroadPhase<Box>::contains(std::uint32_t id) const noexcept {
  return impl_->core.contains(id);
}

template <class Box>
Box BasicBroadPhase<Box>::box(std::uint32_t id) const {
  return impl_->core.box(id);
}

template <class Box>
Filter BasicBroadPhase<Box>::filter(std::uint32_t id) const {
  return impl_->core.filter(id);
}

template <class Box>
auto BasicBroadPhase<Box>::reach(std::uint32_t id) const -> Bound {
  return impl_->core.reach(id);
}

template <class Box>
std::vector<std::uint32_t> BasicBroadPhase<Box>::ids() const {
  return impl_->core.ids();
}

template <class Box>
std::vector<Box> BasicBroadPhase<Box>::boxes() const {
  return of_all(impl_->core, &Core<Box>::box);
}

template <class Box>
std::vector<Filter> BasicBroadPhase<Box>::filters() const {
  return of_all(impl_->core, &Core<Box>::filter);
}

template <class Box>
auto BasicBroadPhase<Box>::reaches() const -> std::vector<Bound> {
  return of_all(impl_->core, &Core<Box>::reach);
}

template <class Box>
std::vector<Pair> BasicBroadPhase<Box>::exclusions() const {
  const std::span<const Pair> pairs = impl_->core.exclusions();
  return {pairs.begin(), pairs.end()};
}

template <class Box>
BasicMappedBoxes<Box> BasicBroadPhase<Box>::map(std::size_t n) {
  const std::span<Box> boxes = changing(impl_).map(n);
  return {boxes, impl_->core.boxes_owner()};
}

template <class Box>
Delta BasicBroadPhase<Box>::update() {
  return updating(impl_).finish();
}

template <class Box>
Delta BasicBroadPhase<Box>::update(const BoxView& boxes) {
  return updating(impl_).update(boxes);
}

template <class Box>
void BasicBroadPhase<Box>::begin() {
  impl_->queries->prepare_begin();
  updating(impl_).begin();
  impl_->core.flush();
}

template <class Box>
void BasicBroadPhase<Box>::begin(const BoxView& boxes) {
  updating(impl_).begin(boxes);
}

template <class Box>
Delta BasicBroadPhase<Box>::finish() {
  impl_->queries->prepare_finish();
  return updating(impl_).finish();
}

template <class Box>
BasicState<Box> BasicBroadPhase<Box>::save() const {
  return BasicState<Box>(impl_->core.save());
}

template <class Box>
Delta BasicBroadPhase<Box>::restore(const BasicState<Box>& state) {
  return updating(impl_).restore(*state.saved_);
}

template <class Box>
void BasicBroadPhase<Box>::shrink() {
  impl_->queries->shrink();
  impl_->core.shrink();
}

template <class Box>
std::vector<Pair> BasicBroadPhase<Box>::pairs() const {
  return impl_->core.pairs();
}

template <class Box>
std::vector<std::uint32_t> BasicBroadPhase<Box>::partners(std::uint32_t id) const {
  return impl_->queries->partners(id);
}

template <class Box>
Hits BasicBroadPhase<Box>::overlapping(const BoxView& boxes, const QueryOptions& options) const {
  return impl_->queries->overlapping(boxes, options);
}

template <class Box>
std::size_t BasicBroadPhase<Box>::overlapping(const Box& box, std::vector<std::uint32_t>& ids,
                                              const QueryOptions& options) const {
  return impl_->queries->overlapping(box, ids, options);
}

template <class Box>
Hits BasicBroadPhase<Box>::nearest(const BoxView& boxes, const QueryOptions& options) const {
  return impl_->queries->nearest(boxes, options);
}

template <class Box>
Hits BasicBroadPhase<Box>::along(const BoxView& starts, std::span<const std::array<Bound, 3>> directions,
                                 std::span<const Bound> lengths, const QueryOptions& options) const {
  return impl_->queries->along(starts, directions, lengths, options);
}

template <class Box>
std::size_t BasicBroadPhase<Box>::size() const noexcept {
  return impl_->core.size();
}

template <class Box>
const Device* BasicBroadPhase<Box>::device() const noexcept {
  return impl_->core.algorithm().device();
}

template <class Box>
MemoryUse BasicBroadPhase<Box>::memory() const noexcept {
  return impl_->core.algorithm().memory();
}

template <class Box>
const AlgorithmInfo& BasicBroadPhase<Box>::algorithm() const noexcept {
  return impl_->info;
}

template <class Box>
std::span<const Stage> BasicBroadPhase<Box>::profile() const noexcept {
  return impl_->core.profile();
}

template class BasicBroadPhase<Aabb>;
template class BasicBroadPhase<Aabb64>;

template <class Box>
bool detail::TreeAccess<Box>::has_all(const BasicBroadPhase<Box>& broad_phase) {
  return broad_phase.impl_->queries->has_all();
}

template <class Box>
void detail::TreeAccess<Box>::find(const BasicBroadPhase<Box>& broad_phase, RankedSearch<Box>& search) {
  broad_phase.impl_->queries->find(search);
}

template struct BROADCL_API detail::TreeAccess<Aabb>;
template struct BROADCL_API detail::TreeAccess<Aabb64>;

std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> labels, std::size_t per_object) {
  const std::vector<Labelled> objects = by_label(labels, per_object);
  std::vector<Pair> pairs;
  for (auto b = objects.begin(); b != objects.end(); ++b) {
    for (auto a = b; a != objects.begin() && (a - 1)->label == b->label; --a) {
      if ((a - 1)->object != b->object) pairs.push_back({(a - 1)->object, b->object});
    }
  }
  return each_once(std::move(pairs));
}

std::vector<Pair> pairs_that_share(std::span<const std::uint32_t> first_labels, std::size_t per_first,
                                   std::span<const std::uint32_t> second_labels, std::size_t per_second) {
  const std::vector<Labelled> first = by_label(first_labels, per_first);
  const std::vector<Labelled> second = by_label(second_labels, per_second);
  std::vector<Pair> pairs;
  auto begin = first.begin();  // of the objects with the label of b
  for (const Labelled& b : second) {
    while (begin != first.end() && begin->label < b.label) ++begin;
    for (auto a = begin; a != first.end() && a->label == b.label; ++a) pairs.push_back({a->object, b.object});
  }
  return each_once(std::move(pairs));
}

Hits overlapping(const BoxView& boxes, const BoxView& queries, const QueryOptions& options,
                 const BroadPhase::Config& config) {
  return query_once(boxes, queries, config,
                    [&](auto& broad_phase) { return broad_phase.overlapping(queries, options); });
}

Hits nearest(const BoxView& boxes, const BoxView& queries, const QueryOptions& options,
             const BroadPhase::Config& config) {
  return query_once(boxes, queries, config,
                    [&](auto& broad_phase) { return broad_phase.nearest(queries, options); });
}

Hits along(const BoxView& boxes, const BoxView& starts, std::span<const std::array<double, 3>> directions,
           std::span<const double> lengths, const QueryOptions& options, const BroadPhase::Config& config) {
  return query_once(boxes, starts, config, [&]<class Box>(BasicBroadPhase<Box>& broad_phase) {
    using Bound = BoundType<Box>;
    const DefaultFloatingPoint as_everywhere;
    std::vector<std::array<Bound, 3>> rounded_directions;
    for (const auto& [x, y, z] : directions)
      rounded_directions.push_back({rounded_to<Bound>(x), rounded_to<Bound>(y), rounded_to<Bound>(z)});
    std::vector<Bound> rounded_lengths;
    for (const double length : lengths) rounded_lengths.push_back(rounded_to<Bound>(length));
    return broad_phase.along(starts, rounded_directions, rounded_lengths, options);
  });
}

std::vector<Pair> overlapping_pairs(const BoxView& boxes, std::span<const Pair> exclusions,
                                    const BroadPhase::Config& config) {
  if (boxes.size() > most_in_search) throw Error::invalid_argument("more than 2147483648 boxes; use fewer");
  refuse_unknown(exclusions, boxes.size(), boxes.size());
  return search_once(boxes, nullptr, sorted_exclusions(exclusions), config);
}

std::vector<Pair> overlapping_pairs(const BoxView& first, const BoxView& second,
                                    std::span<const Pair> exclusions, const BroadPhase::Config& config) {
  if (first.size() > most_in_search || second.size() > most_in_search - first.size()) {
    throw Error::invalid_argument("more than 2147483648 boxes in both sets; use fewer");
  }
  refuse_unknown(exclusions, first.size(), second.size());
  const auto before = static_cast<std::uint32_t>(first.size());
  std::vector<Pair> without(exclusions.begin(), exclusions.end());
  for (Pair& pair : without) pair.b += before;
  std::vector<Pair> pairs = search_once(first, &second, sorted_exclusions(without), config);
  for (Pair& pair : pairs) pair.b -= before;
  return pairs;
}

std::vector<double> squared_distances(const BoxView& boxes, std::span<const Pair> pairs,
                                      const BroadPhase::Config& config) {
  return squared_distances(boxes, boxes, pairs, config);
}

std::vector<double> squared_distances(const BoxView& first, const BoxView& second,
                                      std::span<const Pair> pairs, const BroadPhase::Config& config) {
  for (const auto& [a, b] : pairs) {
    if (a < first.size() && b < second.size()) continue;
    throw Error::invalid_argument("there is no box for the pair (" + std::to_string(a) + ", " +
                                  std::to_string(b) + "); use indices of the boxes");
  }
  std::vector<double> squares(pairs.size());
  const bool are_exact = ExactBoxes::are_needed(first, second);
  const Threads threads(config);
  for_each_part(pairs.size(), threads, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    const DefaultFloatingPoint as_everywhere;
    const auto square = [&](const auto& s, const auto& t) {
      square_distances(s, t, pairs.subspan(begin, end - begin), squares.data() + begin);
    };
    are_exact ? square(BoxReader<Aabb64>(first), BoxReader<Aabb64>(second))
              : square(BoxReader<Aabb>(first), BoxReader<Aabb>(second));
  });
  return squares;
}

}  // namespace broadcl
