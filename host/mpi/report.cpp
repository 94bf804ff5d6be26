#include "mpi/report.hpp"

#include <algorithm>
#include <array>
#include <cstring>

#include <broadcl/filter.hpp>

#include "parallel.hpp"

namespace broadcl::mpi {
namespace {

constexpr std::size_t pairs_per_part = std::size_t{1} << 13U;

/// An object in a region.
struct Occupant {
  MpiId id;
  const Aabb* now;
  const Aabb* last;
  const Filter* filter;
  const Filter* last_filter;
  bool is_another;
};

/// Tells what is reported.
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
    // What overlaps a settled object is in this region, where that has always been known, and no other
    // reports it; what is not in this region does not overlap it.
    // (Pairs are sorted by b, so what is known of it is at hand.)
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
      return {id(slot),
              &objects_.now()[slot],
              &objects_.last()[slot],
              &objects_.filter(slot),
              &objects_.last_filter(slot),
              routes_.is_another(slot)};
    }
    const std::size_t guest = slot - region_.base();
    return {id(slot),
            &region_.guest_now(guest),
            &region_.guest_last(guest),
            &region_.guest_filter(guest),
            &region_.guest_last_filter(guest),
            false};
  }

  std::size_t rank_;
  Report::Of of_;
  const Cuts& cuts_;
  const Objects& objects_;
  const Region& region_;
  const Routes& routes_;
};

/// Puts pairs in canonical order, of which most are, piece by piece.
class Merge {
 public:
  /// @param own Pairs in order, after all of those before.
  /// @param others In any order. Copied.
  void take(std::span<const MpiPair> own, std::span<const MpiPair> others) {
    if (!own.empty()) pieces_.push_back({.own = own, .before = own_count_});
    own_count_ += own.size();
    others_.insert(others_.end(), others.begin(), others.end());
  }

  /// Divides the others into runs, to be sorted one by one, and returns how many.
  std::size_t divide(std::size_t threads) {
    if (pieces_.empty()) pieces_.emplace_back();
    const std::size_t count = std::clamp<std::size_t>(others_.size() / pairs_per_part, 1, threads);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t begin = others_.size() * k / count;
      runs_.push_back(std::span(others_).subspan(begin, others_.size() * (k + 1) / count - begin));
    }
    return count;
  }
  void sort(std::size_t run) const { std::ranges::sort(runs_[run]); }

  /// A list of all pairs, in memory that grows if need be.
  [[nodiscard]] std::span<MpiPair> fit(std::vector<MpiPair>& memory) const {
    const std::size_t count = own_count_ + others_.size();
    if (memory.size() < count) memory.resize(count);
    return std::span(memory).first(count);
  }

  [[nodiscard]] std::size_t pieces() const noexcept { return pieces_.size(); }
  /// Writes the part of the list that begins with a piece and ends before the next one.
  void write(std::size_t piece, std::span<MpiPair> list) const {
    std::vector<MpiPair> others;
    std::size_t before = pieces_[piece].before;
    for (const std::span<const MpiPair> run : runs_) {
      const auto begin = begin_of(piece, run);
      others.insert(others.end(), begin, begin_of(piece + 1, run));
      before += static_cast<std::size_t>(begin - run.begin());
    }
    if (runs_.size() > 1) std::ranges::sort(others);
    std::ranges::merge(pieces_[piece].own, others, list.subspan(before).begin());
  }

 private:
  struct Piece {
    std::span<const MpiPair> own;
    std::size_t before = 0;  // own pairs before it
  };

  [[nodiscard]] std::span<const MpiPair>::iterator begin_of(std::size_t piece,
                                                            std::span<const MpiPair> run) const {
    if (piece == 0) return run.begin();
    if (piece == pieces_.size()) return run.end();
    return std::ranges::lower_bound(run, pieces_[piece].own.front());
  }

  std::vector<Piece> pieces_;
  std::size_t own_count_ = 0;
  std::vector<MpiPair> others_;
  std::vector<std::span<MpiPair>> runs_;
};

}  // namespace

void Report::sift(std::span<const Pair> pairs, Of of, const Cuts& cuts, const Objects& objects,
                  const Region& region, const Routes& routes) {
  const Judge judge(rank_, of, cuts, objects, region, routes);
  std::vector<Part>& parts = of == Of::removed ? removed_ : added_;
  const std::size_t count = std::clamp<std::size_t>(pairs.size() / pairs_per_part, 1, 4 * threads_);
  parts.resize(std::max(count, parts.size()));
  for (Part& part : parts) {
    part.own.clear();
    part.others.resize(ranks_);
    for (std::vector<MpiPair>& list : part.others) list.clear();
  }
  parallel_for(count, threads_, [&](std::size_t k, std::size_t /*thread*/) {
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
                         std::vector<MpiPair>& removed) const {
  std::array<Merge, 2> merges{};
  std::size_t kind = 0;
  for (const std::vector<Part>* parts : {&added_, &removed_}) {
    for (const Part& part : *parts) merges[kind].take(part.own, part.others[rank_]);
    ++kind;
  }
  for (std::size_t rank = 0; rank < ranks_; ++rank) {
    if (rank == rank_) continue;
    const Changed changed(in[rank]);
    merges[0].take({}, changed.added);
    merges[1].take({}, changed.removed);
  }
  // Both lists at the same time.
  const auto in_parts = [&](std::array<std::size_t, 2> counts, const auto& function) {
    const std::size_t count = counts[0] + counts[1];
    parallel_for(count, count > 2 ? threads_ : 1, [&](std::size_t k, std::size_t /*thread*/) {
      k < counts[0] ? function(0, k) : function(1, k - counts[0]);
    });
  };
  const std::array<std::size_t, 2> runs{merges[0].divide(threads_), merges[1].divide(threads_)};
  in_parts(runs, [&](std::size_t list, std::size_t run) { merges.at(list).sort(run); });
  const std::array<std::span<MpiPair>, 2> lists{merges[0].fit(added), merges[1].fit(removed)};
  in_parts({merges[0].pieces(), merges[1].pieces()},
           [&](std::size_t list, std::size_t piece) { merges.at(list).write(piece, lists.at(list)); });
  return {lists[0], lists[1]};
}

}  // namespace broadcl::mpi
