#include "finders/tile_work.hpp"

#include <algorithm>
#include <limits>

#include "opencl/launch.hpp"

namespace broadcl {
namespace {

/// How often, on average, each box may move before boxes are sorted again, if the work is not known.
constexpr std::size_t unwatched = 8;
/// At least 1 / fewest_moved of the boxes must have moved before boxes are sorted again.
constexpr std::size_t fewest_moved = 64;
/// An early search takes more time than it saves if its work is more than this multiple of that of a search
/// of all.
constexpr double most_early_work = 2;
/// A search is given up, and the boxes are sorted, if it takes more work than this many searches of all boxes
/// after sorting, which is far more than is_stale() allows. If all boxes leapt, the work would be n^2.
constexpr double given_up = 4;

}  // namespace

void TileWork::begin_frame(const Search& search, const PairDelta& sink) {
  observe(sink);
  // Another finder did the frames in between; all boxes may have moved in them.
  if (searched_frame_) moved_ += (sink.frames() - *searched_frame_ - 1) * std::size_t{search.now.slots};
  moved_ += search.changed_slots();
  searched_frame_ = sink.frames();
}

void TileWork::observe(const PairDelta& sink) {
  if (!searched_frame_ || sink.frames() != *searched_frame_ + 1 || sink.work() == 0) return;
  factors_.at(kind_) = static_cast<double>(sink.work()) / typical_;
}

/// The last frame's work is compared with that of the first frame since the boxes were sorted that was
/// followed by another one here. If another finder did the last frame, the number of boxes that moved
/// decides.
bool TileWork::is_stale(const Search& search, const PairDelta& sink) {
  if (search.now.slots != sorted_slots_ || search.worlds != sorted_by_world_ || search.sets != sorted_by_set_)
    return true;
  if (sink.frames() == sorted_frame_) return false;
  if (sink.work() == 0) return moved_ > unwatched * search.now.slots;
  double& fresh = fresh_factors_.at(kind_);
  if (fresh == 0) fresh = factors_.at(kind_);
  // The work for some boxes says little, so wait until enough have moved.
  const bool may_be_stale =
      static_cast<double>(moved_ * fewest_moved) >= stale_ * static_cast<double>(search.now.slots);
  return factors_.at(kind_) > stale_ * fresh && may_be_stale;
}

void TileWork::set_sorted(const Search& search, const PairDelta& sink) {
  sorted_by_world_ = search.worlds;
  sorted_by_set_ = search.sets;
  sorted_slots_ = search.now.slots;
  sorted_frame_ = sink.frames();
  fresh_factors_ = {};
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
  const double most = given_up * factor * typical(search.now.slots, search.now.slots);
  // Each work-group may do some more before it knows; the kernel counts in 32 bits.
  const bool overflows = most + static_cast<double>(groups * 2 * layout::REPORTED_WORK) >= any;
  return overflows ? any : static_cast<cl_uint>(most);
}

/// The work of a search after sorting, up to a factor: a constant per tile, and more per box that changed.
double TileWork::typical(const Search& search) const {
  return typical(search.now.slots, search.changed_slots());
}
double TileWork::typical(std::size_t slots, std::size_t changed) const {
  return 4 * static_cast<double>(opencl::divide_up(slots, node_)) + 12 * static_cast<double>(changed);
}

}  // namespace broadcl
