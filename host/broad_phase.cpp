#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <functional>
#include <optional>
#include <queue>
#include <string>
#include <utility>

#include "algorithms/algorithm.hpp"
#include "change_set.hpp"
#include "packed_box.hpp"
#include "pair_lists.hpp"

namespace broadcl {
namespace {

[[noreturn]] void throw_nan(const std::string& what) {
  throw Error(what + " has a NaN bound; give an empty box (lower > upper) for an object without one");
}

bool same_bits(const Aabb& s, const Aabb& t) {
  using Bits = std::array<std::uint32_t, 6>;
  return std::bit_cast<Bits>(s) == std::bit_cast<Bits>(t);
}

/// Changes of pairs that are nobody else's.
struct OwnDelta {
  std::vector<Pair> added;
  std::vector<Pair> removed;
};

/// What two updates changed together. Where a pair ended in the first and began again in the second, nothing
/// changed, unless an object of it was renewed in between.
OwnDelta merge_deltas(const OwnDelta& first, const Delta& second, const SlotSet& renewed) {
  OwnDelta both{.added = merge(difference(first.added, second.removed), second.added),
                .removed = merge(first.removed, difference(second.removed, first.added))};
  std::vector<Pair> back = intersection(both.added, both.removed);
  std::erase_if(back, [&](const Pair& pair) { return renewed.contains(pair.a) || renewed.contains(pair.b); });
  if (back.empty()) return both;
  return {.added = difference(both.added, back), .removed = difference(both.removed, back)};
}

}  // namespace

class BroadPhase::Impl {
 public:
  explicit Impl(const Config& config)
      : row_(find_algorithm(config.algorithm)), algorithm_(make_algorithm(config)) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    refuse_nan(box);
    const auto id = free_.empty() ? static_cast<std::uint32_t>(states_.size()) : free_.top();
    if (id == states_.size()) {
      if (!in_flight_) algorithm_->reserve(states_.size() + 1);
      grow(states_.size() + 1);
    } else {
      free_.pop();
    }
    set_state(id, State::live);
    set_box(id, box);
    store_filter(id, filter);
    return id;
  }

  void move(std::uint32_t id, const Aabb& box) {
    refuse_unknown(id);
    refuse_nan(box);
    set_box(id, box);
  }

  void set_filter(std::uint32_t id, const Filter& filter) {
    refuse_unknown(id);
    store_filter(id, filter);
  }

  void remove(std::uint32_t id) {
    refuse_unknown(id);
    free_.push(id);
    set_state(id, State::free);
    set_box(id, empty_aabb());
  }

  std::span<Aabb> map(std::size_t n) {
    if (in_flight_) throw Error("map() was called between begin() and finish(); call finish() first");
    if (n > most_objects) throw Error("map() was asked for " + std::to_string(n) + " boxes; ask for fewer");
    apply_late();
    algorithm_->reserve(n);
    if (n > states_.size()) grow(n);
    for (std::size_t id = n; id < states_.size(); ++id) {
      if (states_[id] == State::live) remove(static_cast<std::uint32_t>(id));
    }
    std::vector<std::uint32_t> free;
    for (std::size_t id = n; id < states_.size(); ++id) free.push_back(static_cast<std::uint32_t>(id));
    free_ = FreeIds(std::greater<>(), std::move(free));
    const std::span<Aabb> boxes = algorithm_->boxes().first(n);
    for (std::uint32_t id = 0; id < n; ++id) {
      // The caller must not meet a NaN that is not his own.
      const bool is_own = id < mapped_;
      if (states_[id] == State::free || (!is_own && has_nan(boxes[id]))) boxes[id] = empty_aabb();
      if (states_[id] == State::live) continue;
      set_state(id, State::live);
      store_filter(id, Filter());
    }
    changes_.all = true;
    mapped_ = n;
    return boxes;
  }

  void begin() {
    if (in_flight_) return;
    apply_late();
    take_mapped();
    if (changes_.empty()) return;
    const std::size_t slots = slot_count();
    flight_.clear();
    std::swap(flight_, changes_);
    flight_.renewed.sort();
    try {
      algorithm_->begin(
          {.slots = slots,
           .changed = flight_.changed.slots(),
           // Where many changed, testing all pairs once is less work than testing those against all.
           .all = flight_.all || flight_.changed.slots().size() > slots / 4,
           .renewed = flight_.renewed.slots(),
           .filters = any_filters_ ? std::span<const Filter>(filters_) : std::span<const Filter>(),
           .filters_changed = flight_.filters,
           .worlds = any_worlds_});
    } catch (...) {
      take_back();
      throw;
    }
    in_flight_ = true;
  }

  void flush() {
    if (!in_flight_) return;
    try {
      algorithm_->flush();
    } catch (...) {
      take_back();
      throw;
    }
  }

  Delta finish() {
    begin();
    asked_ = in_flight_;
    if (in_flight_) {
      const Delta delta = land();
      if (late_.empty() && changes_.empty() && !pending_) return delta;
      keep(delta);
      begin();
      if (in_flight_) keep(land());
    }
    if (!pending_) return {};
    result_ = std::move(*pending_);
    pending_.reset();
    pending_renewed_.clear();
    return {result_.added, result_.removed};
  }

  [[nodiscard]] std::vector<Pair> pairs() const {
    if (in_flight_) throw Error("pairs() was called between begin() and finish(); call finish() first");
    return algorithm_->pairs();
  }

  [[nodiscard]] std::span<const Stage> profile() const noexcept {
    return asked_ ? algorithm_->profile() : std::span<const Stage>();
  }

  [[nodiscard]] const AlgorithmRow& row() const noexcept { return row_; }
  [[nodiscard]] const Algorithm& algorithm() const noexcept { return *algorithm_; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  enum class State : std::uint8_t { free, live };
  using FreeIds = std::priority_queue<std::uint32_t, std::vector<std::uint32_t>, std::greater<>>;

  static constexpr std::size_t most_objects = std::size_t{1} << 31;

  struct LateBox {
    std::uint32_t id;
    Aabb box;
  };

  void grow(std::size_t ids) {
    states_.resize(ids, State::free);
    filters_.resize(ids);
  }

  void set_state(std::uint32_t id, State state) {
    states_[id] = state;
    size_ = state == State::live ? size_ + 1 : size_ - 1;
    changes_.changed.insert(id);
    changes_.renewed.insert(id);
  }

  void set_box(std::uint32_t id, const Aabb& box) {
    if (in_flight_ || !late_.empty()) return late_.push_back({id, box});
    Aabb& old = algorithm_->boxes()[id];
    const Aabb packed = id < mapped_ ? box : pack(box);
    if (same_bits(old, packed)) return;
    old = packed;
    changes_.changed.insert(id);
  }

  void store_filter(std::uint32_t id, const Filter& filter) {
    if (filters_[id] == filter) return;
    filters_[id] = filter;
    any_filters_ = any_filters_ || filter != Filter();
    any_worlds_ = any_worlds_ || filter.world != 0;
    changes_.changed.insert(id);
    changes_.filters = true;
  }

  /// Boxes that were set between begin() and finish(), and, where that failed, since.
  void apply_late() {
    if (late_.empty()) return;
    algorithm_->reserve(states_.size());
    const std::vector<LateBox> late_boxes = std::exchange(late_, {});
    for (const LateBox& late : late_boxes) set_box(late.id, late.box);
  }

  /// Boxes that the caller wrote in place.
  void take_mapped() {
    if (mapped_ == 0) return;
    const std::span<Aabb> boxes = algorithm_->boxes().first(mapped_);
    const auto bad = std::find_if(boxes.begin(), boxes.end(), has_nan);
    if (bad != boxes.end()) throw_nan("box " + std::to_string(bad - boxes.begin()));
    for (Aabb& box : boxes) {
      if (!packed_overlaps(box, box)) box = packed_empty();
    }
    mapped_ = 0;
  }

  /// Ends the update that is in flight.
  Delta land() {
    try {
      const Delta delta = algorithm_->finish();
      in_flight_ = false;
      return delta;
    } catch (...) {
      take_back();
      throw;
    }
  }

  /// The update that was begun failed: what it was to find is still to be found.
  void take_back() {
    in_flight_ = false;
    changes_.add(flight_);
    changes_.all = changes_.filters = true;
  }

  /// Adds what the update that ended changed to what the caller was not told yet.
  void keep(const Delta& delta) {
    pending_renewed_.insert(flight_.renewed.slots());
    if (pending_) {
      pending_ = merge_deltas(*pending_, delta, pending_renewed_);
    } else {
      pending_ = OwnDelta{.added = {delta.added.begin(), delta.added.end()},
                          .removed = {delta.removed.begin(), delta.removed.end()}};
    }
  }

  /// Slots up to the last object.
  [[nodiscard]] std::size_t slot_count() const {
    const auto last = std::find(states_.rbegin(), states_.rend(), State::live);
    return static_cast<std::size_t>(states_.rend() - last);
  }

  void refuse_unknown(std::uint32_t id) const {
    if (id >= states_.size() || states_[id] == State::free) {
      throw Error("no object has the id " + std::to_string(id) + "; use the ids that add() returned");
    }
  }

  static void refuse_nan(const Aabb& box) {
    if (has_nan(box)) throw_nan("a box");
  }

  const AlgorithmRow& row_;
  std::unique_ptr<Algorithm> algorithm_;
  std::vector<State> states_;    // a slot each
  std::vector<Filter> filters_;  // a slot each
  FreeIds free_;
  std::size_t size_ = 0;
  bool any_filters_ = false;  // some object ever had another than the default one
  bool any_worlds_ = false;
  std::size_t mapped_ = 0;  // boxes that the caller may have written in place

  ChangeSet changes_;  // since the last update began
  ChangeSet flight_;   // what that update takes in
  bool in_flight_ = false;
  bool asked_ = false;         // the algorithm, in the last update
  std::vector<LateBox> late_;  // not stored yet: set while it was in flight

  std::optional<OwnDelta> pending_;  // what changed in updates that the caller was not told of
  SlotSet pending_renewed_;          // in these
  OwnDelta result_;
};

BroadPhase::BroadPhase() : BroadPhase(Config()) {}
BroadPhase::BroadPhase(const Config& config) : impl_(std::make_unique<Impl>(config)) {}
BroadPhase::~BroadPhase() = default;
BroadPhase::BroadPhase(BroadPhase&&) noexcept = default;
BroadPhase& BroadPhase::operator=(BroadPhase&&) noexcept = default;

std::uint32_t BroadPhase::add(const Aabb& box, const Filter& filter) {
  return impl_->add(box, filter);
}

void BroadPhase::move(std::uint32_t id, const Aabb& box) {
  impl_->move(id, box);
}

void BroadPhase::set_filter(std::uint32_t id, const Filter& filter) {
  impl_->set_filter(id, filter);
}

void BroadPhase::remove(std::uint32_t id) {
  impl_->remove(id);
}

std::span<Aabb> BroadPhase::map(std::size_t n) {
  return impl_->map(n);
}

Delta BroadPhase::update() {
  return impl_->finish();
}

void BroadPhase::begin() {
  impl_->begin();
  impl_->flush();
}

Delta BroadPhase::finish() {
  return impl_->finish();
}

std::vector<Pair> BroadPhase::pairs() const {
  return impl_->pairs();
}

std::size_t BroadPhase::size() const noexcept {
  return impl_->size();
}

const Device* BroadPhase::device() const noexcept {
  return impl_->algorithm().device();
}

MemoryUse BroadPhase::memory() const noexcept {
  return impl_->algorithm().memory();
}

const AlgorithmInfo& BroadPhase::algorithm() const noexcept {
  return impl_->row().info;
}

std::span<const Stage> BroadPhase::profile() const noexcept {
  return impl_->profile();
}

std::vector<Pair> overlapping_pairs(const BoxView& boxes, const BroadPhase::Config& config) {
  const auto algorithm = make_algorithm(config);
  algorithm->reserve(boxes.size());
  boxes.pack_to(algorithm->boxes());
  algorithm->begin({.slots = boxes.size(), .all = true});
  const Delta delta = algorithm->finish();
  return {delta.added.begin(), delta.added.end()};
}

}  // namespace broadcl
