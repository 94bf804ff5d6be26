#include "mpi/report.hpp"

#include <algorithm>
#include <cstring>

#include <broadcl/filter.hpp>

namespace broadcl::mpi {
namespace {

constexpr std::size_t pairs_per_part = std::size_t{1} << 13U;

/// An object in a region.
struct Occupant {
  const Aabb* now;
  const Aabb* last;
  const Filter* filter;
  const Filter* last_filter;
  bool is_another;
};

/// Decides whether a pair is reported.
class Judge {
 public:
  Judge(std::size_t rank, Report::Of of, const Cuts& cuts, const Objects& objects, const Region& region,
        const Routes& routes)
      : rank_(rank), of_(of), cuts_(cuts), objects_(objects), region_(region), routes_(routes) {}

  [[nodiscard]] MpiId id(std::uint32_t slot) const {
    return is_own(slot) ? mpi_id(static_cast<int>(rank_), slot) : region_.guest_id(slot - region_.base());
  }
  [[nodiscard]] bool is_own(std::uint32_t slot) const { return slot < region_.base(); }

  [[nodiscard]] bool reports(const Pair& pair) const {
    // A settled object is only in this region, now and before, so this region knows all objects that overlap
    // it, and no other region reports its pairs. (Pairs are sorted by b, so the state of b is still at hand.)
    if (is_settled(pair.b) || is_settled(pair.a)) return true;
    const Occupant a = occupant(pair.a);
    const Occupant b = occupant(pair.b);
    const bool is_now = of_ == Report::Of::added;
    Point point{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      point[axis] = std::max((is_now ? a.now : a.last)->lower[axis], (is_now ? b.now : b.last)->lower[axis]);
    }
    if (cuts_.region_of(point) != rank_) return false;
    if (of_ == Report::Of::all || a.is_another || b.is_another) return true;
    return is_now ? !are_pair(*a.last, *b.last, *a.last_filter, *b.last_filter)
                  : !are_pair(*a.now, *b.now, *a.filter, *b.filter);
  }

 private:
  [[nodiscard]] bool is_settled(std::uint32_t slot) const { return is_own(slot) && routes_.is_settled(slot); }

  static bool are_pair(const Aabb& a, const Aabb& b, const Filter& filter_a, const Filter& filter_b) {
    return overlaps(a, b) && may_pair(filter_a, filter_b);
  }

  [[nodiscard]] Occupant occupant(std::uint32_t slot) const {
    if (is_own(slot)) {
      return {&objects_.now()[slot], &objects_.last()[slot], &objects_.filter(slot),
              &objects_.last_filter(slot), routes_.is_another(slot)};
    }
    const std::size_t guest = slot - region_.base();
    return {&region_.guest_now(guest), &region_.guest_last(guest), &region_.guest_filter(guest),
            &region_.guest_last_filter(guest), false};
  }

  std::size_t rank_;
  Report::Of of_;
  const Cuts& cuts_;
  const Objects& objects_;
  const Region& region_;
  const Routes& routes_;
};

}  // namespace

void Report::sift(std::span<const Pair> pairs, Of of, const Cuts& cuts, const Objects& objects,
                  const Region& region, const Routes& routes) {
  const Judge judge(rank_, of, cuts, objects, region, routes);
  std::vector<Part>& parts = of == Of::removed ? removed_ : added_;
  const std::size_t count = std::clamp<std::size_t>(pairs.size() / pairs_per_part, 1, 4 * workers_.threads());
  parts.resize(std::max(count, parts.size()));
  for (Part& part : parts) {
    part.own.clear();
    part.others.resize(ranks_);
    for (std::vector<MpiPair>& list : part.others) list.clear();
  }
  workers_.for_each(count, [&](std::size_t task) {
    const std::size_t k = count - 1 - task;  // the last ones, with objects of other ranks, take longest
    const std::size_t begin = pairs.size() * k / count;
    const std::size_t end = pairs.size() * (k + 1) / count;
    for (const Pair& pair : pairs.subspan(begin, end - begin)) {
      if (!judge.reports(pair)) continue;
      const MpiId s = judge.id(pair.a);
      const MpiId t = judge.id(pair.b);
      const MpiPair found{std::min(s, t), std::max(s, t)};
      const bool is_own = judge.is_own(pair.a) && judge.is_own(pair.b);
      (is_own ? parts[k].own : parts[k].others[static_cast<std::size_t>(rank_of(found.a))]).push_back(found);
    }
  });
}

void Report::write(std::vector<Bytes>& out) const {
  out.resize(ranks_);
  for (std::size_t rank = 0; rank < ranks_; ++rank) {
    Counts<2> counts{};
    for (const Part& part : added_) counts.of[0] += part.others[rank].size();
    for (const Part& part : removed_) counts.of[1] += part.others[rank].size();
    const std::size_t pairs = counts.of[0] + counts.of[1];
    if (pairs == 0 || rank == rank_) {
      out[rank].resize(0);
      continue;
    }
    out[rank].resize(sizeof(counts) + pairs * sizeof(MpiPair));
    std::byte* end = out[rank].data();
    std::memcpy(end, &counts, sizeof(counts));
    end += sizeof(counts);
    for (const std::vector<Part>* parts : {&added_, &removed_}) {
      for (const Part& part : *parts) {
        const std::vector<MpiPair>& list = part.others[rank];
        if (list.empty()) continue;
        std::memcpy(end, list.data(), list.size() * sizeof(MpiPair));
        end += list.size() * sizeof(MpiPair);
      }
    }
  }
}

MpiDelta Report::collect(const std::vector<Bytes>& in, std::vector<MpiPair>& added,
                         std::vector<MpiPair>& removed) {
  Merge& merge_added = merges_[0];
  Merge& merge_removed = merges_[1];
  const auto take = [this](const std::vector<Part>& parts, Merge& merge) {
    merge.clear();
    for (const Part& part : parts) {
      merge.take_sorted(part.own);
      merge.take(part.others[rank_]);
    }
  };
  take(added_, merge_added);
  take(removed_, merge_removed);
  for (std::size_t rank = 0; rank < ranks_; ++rank) {
    if (rank == rank_) continue;
    const Changed changed(in[rank]);
    merge_added.take(changed.added);
    merge_removed.take(changed.removed);
  }
  // Both lists at the same time.
  const bool are_many = merge_added.size() + merge_removed.size() > 4 * pairs_per_part;
  const auto for_each = [&](std::size_t of_added, std::size_t of_removed, const auto& function) {
    const auto task = [&](std::size_t k) { k < of_added ? function(0, k) : function(1, k - of_added); };
    if (are_many) {
      workers_.for_each(of_added + of_removed, task);
    } else {
      for (std::size_t k = 0; k < of_added + of_removed; ++k) task(k);
    }
  };
  const std::size_t runs = merge_added.begin_sort();
  for_each(runs, merge_removed.begin_sort(),
           [&](std::size_t list, std::size_t task) { merges_.at(list).sort(task); });
  const std::size_t parts = merge_added.begin_merge(added);
  for_each(parts, merge_removed.begin_merge(removed), [&](std::size_t list, std::size_t task) {
    merges_.at(list).merge(task, list == 0 ? added : removed);
  });
  return {std::span(added).first(merge_added.size()), std::span(removed).first(merge_removed.size())};
}

}  // namespace broadcl::mpi
