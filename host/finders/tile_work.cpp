#include "finders/tile_work.hpp"

#include <algorithm>
#include <limits>

#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// The excess per box that has moved, if the work is not known.
constexpr double unwatched = 0.375;
/// The excess per object that came or went: a place in the order is wasted, or in a wrong place.
constexpr double replaced = 6;
/// An early search takes more time than it saves if its work is more than this multiple of that of a search
/// of all.
constexpr double most_early_work = 2;

}  // namespace

bool TileWork::begin_frame(const Search& search, const PairDelta& sink) {
  const double excess = this->excess(search, sink);
  searched_frame_ = sink.frames();
  moved_ = search.changed_slots();
  if (search.now.slots != sorted_slots_ || search.worlds != sorted_by_world_ || search.sets != sorted_by_set_)
    return true;
  if (sink.frames() == sorted_frame_) return false;
  // (The next excess is at least as much.)
  return order_.must_change(excess + replaced * search.changed.recycled, sort_work(search) - excess) ||
         !unsorted_.is_over(sink.frames());
}

/// What the last search took more than the first of its kind since the boxes were sorted.
double TileWork::excess(const Search& search, const PairDelta& sink) {
  const std::size_t frames = searched_frame_ ? sink.frames() - *searched_frame_ : 0;
  if (frames == 0) return 0;
  // If another finder did the frames in between, all boxes may have moved in them.
  if (frames > 1 || sink.work() == 0)
    return unwatched * (moved_ + static_cast<double>((frames - 1) * search.now.slots));
  factors_.at(kind_) = static_cast<double>(sink.work()) / typical_;
  double& fresh = fresh_factors_.at(kind_);
  if (fresh == 0) fresh = factors_.at(kind_);
  const double excess = (factors_.at(kind_) - fresh) * typical_;
  if (excess > sort_work(search)) {
    unsorted_.start(*searched_frame_);
  } else if (sorted_frame_ != *searched_frame_) {
    unsorted_.shorten();
  }
  return excess;
}

void TileWork::set_sorted(const Search& search, const PairDelta& sink) {
  sorted_by_world_ = search.worlds;
  sorted_by_set_ = search.sets;
  sorted_slots_ = search.now.slots;
  sorted_frame_ = sink.frames();
  fresh_factors_ = {};
  order_ = {};
  moved_ = 0;
}

void TileWork::begin_search(const Search& search, bool is_early) {
  kind_ = is_early ? early : search.changed.all ? all_changed : some_changed;
  typical_ = typical(search);
}

bool TileWork::early_pays() const noexcept {
  return factors_[early] <= most_early_work * factors_[all_changed];
}

cl_uint TileWork::most(const Search& search, const PairDelta& sink, std::size_t groups) const {
  constexpr cl_uint any = std::numeric_limits<cl_uint>::max();
  if (!search.may_give_up || sink.frames() == sorted_frame_) return any;
  const double factor =
      std::max({default_factors[all_changed], factors_[all_changed], fresh_factors_[all_changed]});
  const double most = factor * typical(search.now.slots, search.now.slots) + sort_work(search);
  // Each work-group may do some more before it knows; the kernel counts in 32 bits.
  const bool overflows = most + static_cast<double>(groups * 2 * layout::REPORTED_WORK) >= any;
  return overflows ? any : static_cast<cl_uint>(most);
}

double TileWork::sort_work(const Search& search) const {
  return sort_work_ * static_cast<double>(search.now.slots);
}

/// The work of a search after sorting, up to a factor: a constant per tile, and more per box that changed.
double TileWork::typical(const Search& search) const {
  return typical(search.now.slots, search.changed_slots());
}
double TileWork::typical(std::size_t slots, std::size_t changed) const {
  return 4 * static_cast<double>(opencl::divide_up(slots, node_)) + 12 * static_cast<double>(changed);
}

}  // namespace broadcl
