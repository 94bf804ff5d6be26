#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include <broadcl/error.hpp>

#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/moving_box.hpp"
#include "base/packed_boxes.hpp"
#include "core/queries.hpp"
#include "core/query_batch.hpp"
#include "core/reach.hpp"

/// Queries whose hits are in the order of a key.
namespace broadcl {
namespace {

/// The hits of a query.
template <class Box>
class RankedHits final : public RankedSearch<Box> {
 public:
  using Bound = BoundType<Box>;

  RankedHits(const Searched<Box>& in, const QueryRules<Box>& rules, std::uint32_t limit)
      : in_(in), rules_(rules), limit_(limit) {
    this->is_limited = limit != QueryOptions::all;
    this->map = in.core.map_of_boxes();
  }

  void clear() noexcept {
    hits_.clear();
    is_heap_ = false;
  }

  /// Finds what is nearest to `box`.
  void find_nearest(std::uint32_t query, const std::optional<double>& within) {
    const Bound distance = within ? rounded_to<Bound>(*within) : std::numeric_limits<Bound>::infinity();
    must_overlap_ = distance < least_distance<Bound>;
    find(query, distance * distance);
  }

  /// Finds what `moving` meets.
  void find_along(std::uint32_t query) { find(query, this->moving->length); }

  void take(std::uint32_t slot, Bound key) override {
    if (in_.unread_set.contains(slot)) return;
    is_exact ? test(slot) : add(slot, key);
  }

  /// Appends what was found, in order.
  void append_to(FoundHits& found, std::uint32_t& count) {
    if (limit_ > most_in_order) std::sort(hits_.begin(), hits_.end());
    for (const Ranked& hit : hits_) {
      found.slots.push_back(hit.slot);
      found.keys.push_back(static_cast<double>(hit.key));
    }
    count = static_cast<std::uint32_t>(hits_.size());
  }

 private:
  static constexpr bool is_exact = std::is_same_v<Box, Aabb64>;
  /// Up to so many hits are kept in order; more, as a heap once they are as many as the limit.
  static constexpr std::size_t most_in_order = 64;

  struct Ranked {
    Bound key;
    std::uint32_t slot;
    bool operator<(const Ranked& other) const noexcept {
      return key < other.key || (key == other.key && slot < other.slot);
    }
  };

  void find(std::uint32_t query, Bound greatest_key) {
    if (limit_ == 0) return;
    query_ = query;
    this->most = greatest_key;
    this->last = RankedSearch<Box>::any_slot;
    this->world = rules_.world_of(query);
    for (const std::uint32_t id : in_.unread) test(id);
    if (in_.tree != nullptr) {
      in_.tree->find(*this);
    } else {
      for (std::uint32_t id = 0; id < in_.slots; ++id) test(id);
    }
  }

  void test(std::uint32_t id) {
    const Box other = in_.core.packed_box(id);
    if (has_nan(other)) return;
    if (this->moving == nullptr) {
      add(id, squared_distance(this->box, other));
    } else if (const std::optional<Bound> time = time_of_meeting(*this->moving, other)) {
      add(id, *time);
    }
  }

  void add(std::uint32_t id, Bound key) {
    if (!this->wants(key, id) || !rules_.accept(query_, id)) return;
    if (must_overlap_ && !packed_overlaps(this->box, in_.core.packed_box(id))) return;
    const Ranked hit{key, id};
    if (hits_.size() == limit_) {
      if (limit_ > most_in_order) std::pop_heap(hits_.begin(), hits_.end());
      hits_.pop_back();
    }
    hits_.push_back(hit);
    if (limit_ <= most_in_order) {
      auto place = hits_.end() - 1;
      for (; place != hits_.begin() && hit < *(place - 1); --place) *place = *(place - 1);
      *place = hit;
    } else if (hits_.size() == limit_) {
      is_heap_ ? std::push_heap(hits_.begin(), hits_.end()) : std::make_heap(hits_.begin(), hits_.end());
      is_heap_ = true;
    }
    if (hits_.size() < limit_) return;
    const Ranked& last_one = limit_ > most_in_order ? hits_.front() : hits_.back();
    this->most = last_one.key;
    this->last = static_cast<std::int32_t>(last_one.slot) - 1;
  }

  const Searched<Box>& in_;
  const QueryRules<Box>& rules_;
  std::size_t limit_;
  std::uint32_t query_ = 0;
  bool must_overlap_ = false;  // since gaps that count as 0 are too much
  std::vector<Ranked> hits_;
  bool is_heap_ = false;
};

/// The hits of queries whose boxes are packed.
/// @param find Called with the hits and a query whose box is not empty.
template <class Box, class Find>
Hits search(const Searched<Box>& in, std::span<const Box> boxes, const QueryOptions& options,
            const Find& find) {
  std::vector<Aabb> images(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) images[k] = in.core.image_of(boxes[k]);
  const QueryRules<Box> rules(in.core, options);
  return collect_hits(images, options, in.threads,
                      [&](std::span<const std::uint32_t> tile, FoundHits& found) {
                        const DefaultFloatingPoint as_everywhere;
                        RankedHits<Box> hits(in, rules, options.limit);
                        for (std::size_t k = 0; k < tile.size(); ++k) {
                          hits.clear();
                          if (is_proper(boxes[tile[k]])) find(hits, tile[k]);
                          hits.append_to(found, found.counts.at(k));
                        }
                      });
}

/// @throws Error unless there is one for each query, or one for all of them.
void refuse_count(std::size_t count, const char* of, std::size_t queries) {
  if (count == 1 || count == queries) return;
  throw Error::invalid_argument(std::to_string(count) + " " + of + " for " + std::to_string(queries) +
                                " queries; give one for all, or one for each");
}

template <class Box>
bool is_infinite(const Box& box) noexcept {
  const auto is_so = [](auto bound) { return std::isinf(bound); };
  return std::ranges::any_of(box.lower, is_so) || std::ranges::any_of(box.upper, is_so);
}

}  // namespace

template <class Box>
Hits Queries<Box>::nearest(const BoxView& boxes, const QueryOptions& options) {
  refuse_options(options, boxes.size());
  const std::vector<Box> packed = packed_boxes<Box>(boxes, threads_);
  return answer(packed.size(), [&](const Searched<Box>& in) {
    return search(in, std::span(packed), options, [&](RankedHits<Box>& of_query, std::uint32_t query) {
      of_query.box = packed[query];
      of_query.find_nearest(query, options.within);
    });
  });
}

template <class Box>
Hits Queries<Box>::along(const BoxView& starts, std::span<const std::array<Bound, 3>> directions,
                         std::span<const Bound> lengths, const QueryOptions& options) {
  const std::size_t n = starts.size();
  refuse_options(options, n);
  refuse_count(directions.size(), "directions", n);
  if (!lengths.empty()) refuse_count(lengths.size(), "lengths", n);
  if (options.within) {
    throw Error::invalid_argument("within is given, but what moves meets boxes; enlarge the starts instead");
  }
  for (std::size_t k = 0; k < directions.size(); ++k) {
    if (std::ranges::all_of(directions[k], [](Bound component) { return std::isfinite(component); }))
      continue;
    throw Error::invalid_argument("direction " + std::to_string(k) +
                                  " is infinite or NaN; give a finite one, and its length apart");
  }
  for (std::size_t k = 0; k < lengths.size(); ++k) {
    if (lengths[k] >= 0) continue;
    throw Error::invalid_argument("length " + std::to_string(k) + " is " + std::to_string(lengths[k]) +
                                  "; give one from 0 on");
  }
  const std::vector<Box> packed = packed_boxes<Box>(starts, threads_);
  const auto infinite = std::ranges::find_if(packed, is_infinite<Box>);
  if (infinite != packed.end()) {
    throw Error::invalid_argument("start " + std::to_string(infinite - packed.begin()) +
                                  " is infinite, so it cannot move; give finite starts");
  }
  Hits hits = answer(n, [&](const Searched<Box>& in) {
    return search(in, std::span(packed), options, [&](RankedHits<Box>& of_query, std::uint32_t query) {
      MovingBox<Box> moving{.box = packed[query], .length = std::numeric_limits<Bound>::infinity()};
      if (!lengths.empty()) moving.length = lengths[lengths.size() == 1 ? 0 : query];
      std::ranges::transform(directions[directions.size() == 1 ? 0 : query], moving.reciprocals.begin(),
                             reciprocal_of<Bound>);
      of_query.moving = &moving;
      of_query.find_along(query);
    });
  });
  hits.times.swap(hits.squared_distances);
  return hits;
}

template Hits Queries<Aabb>::nearest(const BoxView&, const QueryOptions&);
template Hits Queries<Aabb64>::nearest(const BoxView&, const QueryOptions&);
template Hits Queries<Aabb>::along(const BoxView&, std::span<const std::array<float, 3>>,
                                   std::span<const float>, const QueryOptions&);
template Hits Queries<Aabb64>::along(const BoxView&, std::span<const std::array<double, 3>>,
                                     std::span<const double>, const QueryOptions&);

}  // namespace broadcl
