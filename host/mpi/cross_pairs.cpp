#include "mpi/cross_pairs.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "mpi/near_parts.hpp"

namespace broadcl::mpi {
namespace {

bool any(const std::vector<std::uint8_t>& flags) {
  return std::ranges::find(flags, 1) != flags.end();
}

/// A message about changed pairs, for the rank of their first objects: how many were added, then these, then
/// those that were removed.
void write(const PairChanges& changes, Bytes& message) {
  if (changes.added.empty() && changes.removed.empty()) return message.resize(0);
  const MpiPair counts{.a = changes.added.size(), .b = changes.removed.size()};
  message.resize((1 + counts.a + counts.b) * sizeof(MpiPair));
  auto* pairs = reinterpret_cast<MpiPair*>(message.data());
  *pairs = counts;
  std::ranges::copy(changes.added, pairs + 1);
  std::ranges::copy(changes.removed, pairs + 1 + counts.a);
}

void append(const Bytes& message, std::vector<MpiPair>& added, std::vector<MpiPair>& removed) {
  if (message.size() == 0) return;
  const auto* pairs = reinterpret_cast<const MpiPair*>(message.data());
  const auto [add, remove] = *pairs++;
  added.insert(added.end(), pairs, pairs + add);
  removed.insert(removed.end(), pairs + add, pairs + add + remove);
}

}  // namespace

CrossPairs::CrossPairs(const Config& config, std::size_t rank, std::size_t ranks)
    : rank_(rank),
      threads_(config),
      halos_(ranks),
      search_(config, rank, ranks),
      near_(ranks),
      out_(ranks),
      in_(ranks) {}

void CrossPairs::set_exclusions(std::vector<MpiPair> pairs) noexcept {
  exclusions_ = std::move(pairs);
  have_exclusions_changed_ = true;
}

std::span<const MpiPair> CrossPairs::exclusions_with(std::size_t other) const {
  const auto rank = [](const MpiPair& pair) { return static_cast<std::size_t>(rank_of(pair.b)); };
  const auto begin = std::ranges::lower_bound(exclusions_, other, {}, rank);
  return {begin, std::ranges::upper_bound(begin, exclusions_.end(), other, {}, rank)};
}

/// Receives messages of the ranks that send to this one, and that of this rank to itself.
void CrossPairs::receive_halos() {
  for (std::size_t other = 0; other < in_.size(); ++other) {
    const bool is_own = other == rank_;
    if (!is_own && sends(rank_, other)) continue;
    HaloChanges changes = HaloChanges::read(is_own ? own_halo_ : in_[other]);
    search_.receive(other, changes);
    // This rank finds the pair, and its exclusions are those of the lower rank.
    if (have_exclusions_changed_ && rank_ < other) {
      search_.set_exclusions(other, exclusions_with(other));
    }
  }
}

void CrossPairs::exchange(const Ranks& ranks) {
  ranks.exchange(out_, in_);
  for (const Bytes& message : out_) bytes_sent_ += message.size();
}

void CrossPairs::restore(const Ranks& ranks) {
  bytes_sent_ = 0;
  if (halos_.size() == 1) return;
  if (!any(ranks.gather(std::uint8_t{is_lost_}))) return;
  is_lost_ = are_bounds_due_ = true;
  ranks.together([&] {
    search_.clear();
    for (std::size_t other = 0; other < halos_.size(); ++other) {
      halos_[other].write_last(other == rank_ ? own_halo_ : out_[other]);
    }
  });
  exchange(ranks);
  ranks.together([&] {
    for (std::size_t other = 0; other < in_.size(); ++other) {
      if (other == rank_ || !sends(rank_, other)) {
        search_.receive(other, HaloChanges::read(other == rank_ ? own_halo_ : in_[other]));
      }
    }
    search_.find();
  });
  search_.commit();
  is_lost_ = false;
}

void CrossPairs::exchange_bounds(const Ranks& ranks, Objects& objects, bool is_due) {
  are_bounds_due_ = true;  // until all of this is done
  ranks.together([&] {
    if (!is_due) return;
    const std::span<const Aabb> boxes = objects.boxes();
    const Grid grid(sample_of(boxes));
    own_bounds_.renew(grid, survey_of(grid, boxes, threads_), objects.count());
  });
  const std::vector<Bounds> bounds = ranks.gather(own_bounds_.get());
  ranks.together([&] { neighbours_.set(rank_, own_bounds_, bounds); });
  const std::vector<Aabb> interiors = ranks.gather(neighbours_.interior());
  neighbours_.set_interior(rank_, interiors);
  are_bounds_due_ = false;
}

/// Starts the update of the objects, and finds those that belong to halos, with bounds that are true for all
/// ranks.
void CrossPairs::find_halos(const Ranks& ranks, Objects& objects, Stages& stages) {
  bool is_all = objects.have_all_changed();
  bool is_due = are_bounds_due_ || own_bounds_.are_due(objects.count());
  const bool are_due = any(ranks.gather(std::uint8_t{is_due}));
  ranks.together([&] {
    const bool are_inside = objects.begin(are_due ? nullptr : &own_bounds_, neighbours_, near_);
    is_due = is_due || !are_inside;
  });
  stages.end("begin");
  while (any(ranks.gather(std::uint8_t{is_due}))) {
    exchange_bounds(ranks, objects, is_due);
    is_all = true;
    ranks.together([&] {
      is_due = !find_near(own_bounds_, neighbours_, objects.boxes(), objects.filters(), threads_, near_);
    });
  }
  ranks.together([&] {
    for (std::size_t other = 0; other < halos_.size(); ++other) {
      HaloHistory& halo = halos_[other];
      halo.renew(near_[other], is_all, objects.changed());
      HaloChanges exclusions;
      if (have_exclusions_changed_ && rank_ < other && sends(rank_, other)) {
        exclusions = {.exclusions = exclusions_with(other), .has_exclusions = true};
      }
      halo.write(objects.recycled(), exclusions, threads_, other == rank_ ? own_halo_ : out_[other]);
    }
  });
}

void CrossPairs::write_pairs() {
  for (std::size_t other = 0; other < out_.size(); ++other) {
    if (other < rank_ && sends(other, rank_)) {
      write(search_.changes_with(other), out_[other]);
    } else {
      out_[other].resize(0);
    }
  }
}

/// Pairs are in canonical order if those with lower ranks come first.
void CrossPairs::collect() {
  added_.clear();
  removed_.clear();
  for (std::size_t other = rank_ + 1; other < in_.size(); ++other) {
    if (sends(rank_, other)) {
      append(in_[other], added_, removed_);
    } else {
      const auto& [added, removed] = search_.changes_with(other);
      added_.insert(added_.end(), added.begin(), added.end());
      removed_.insert(removed_.end(), removed.begin(), removed.end());
    }
  }
}

void CrossPairs::update(const Ranks& ranks, Objects& objects, Stages& stages) {
  if (halos_.size() == 1) {
    ranks.together([&] { (void)objects.begin(nullptr, neighbours_, near_); });
    return stages.end("begin");
  }
  is_lost_ = true;  // until commit()
  find_halos(ranks, objects, stages);
  is_any_changed_ = objects.have_all_changed() || !objects.changed().empty();
  stages.end("halo");
  exchange(ranks);
  stages.end("send");
  ranks.together([&] {
    receive_halos();
    search_.find();
    write_pairs();
  });
  stages.end("find");
  exchange(ranks);
  ranks.together([&] { collect(); });
  stages.end("return");
}

void CrossPairs::commit() noexcept {
  search_.commit();
  for (HaloHistory& halo : halos_) halo.commit();
  have_exclusions_changed_ = false;
  if (is_any_changed_) own_bounds_.grow_older();
  is_lost_ = false;
}

std::vector<MpiPair> CrossPairs::pairs(const Ranks& ranks) {
  if (halos_.size() == 1) return {};
  std::vector<std::vector<MpiPair>> found;
  ranks.together([&] {
    found = search_.pairs();
    for (std::size_t other = 0; other < out_.size(); ++other) {
      out_[other].resize(0);
      if (other < rank_ && sends(other, rank_)) write({.added = found[other], .removed = {}}, out_[other]);
    }
  });
  exchange(ranks);
  std::vector<MpiPair> pairs;
  ranks.together([&] {
    std::vector<MpiPair> none;
    for (std::size_t other = rank_ + 1; other < in_.size(); ++other) {
      if (sends(rank_, other)) {
        append(in_[other], pairs, none);
      } else {
        pairs.insert(pairs.end(), found[other].begin(), found[other].end());
      }
    }
  });
  return pairs;
}

}  // namespace broadcl::mpi
