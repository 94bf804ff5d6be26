#include "engines/host_engine.hpp"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>

#include "base/free_lists.hpp"
#include "base/kept_boxes.hpp"
#include "base/pair_lists.hpp"
#include "base/system.hpp"
#include "engines/box_tree.hpp"
#include "engines/change_lists.hpp"
#include "engines/changing_pairs.hpp"
#include "engines/touching.hpp"

namespace broadcl {
namespace {

/// To look at so many pairs takes as long as to search for those of one box, and at so many as to sort one
/// that is found.
constexpr std::size_t pairs_per_search = 256;
constexpr std::size_t pairs_per_found = 3;

class HostEngine final : public Algorithm {
 public:
  HostEngine(std::unique_ptr<HostFinder> finder, const Threads& threads)
      : finder_(std::move(finder)), threads_(threads), parts_(threads) {}

  void reserve(std::size_t slots, bool /*filters*/) override { boxes_.reserve(slots); }
  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return boxes_.get(); }
  [[nodiscard]] std::span<Aabb> spare_boxes() override { return boxes_.spare(); }
  void swap_boxes() noexcept override { boxes_.swap(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return boxes_.owner(); }

  void begin(const Input& input) override {
    input_ = input;
    const PairRules& rules = input.rules;
    if (input.changed.all) {
      reaches_.assign(rules.reaches.begin(), rules.reaches.end());
    } else {
      reaches_.resize(rules.reaches.size());  // one that never changed is 0
      for (const std::uint32_t slot :
           rules.reaches.empty() ? std::span<const std::uint32_t>() : input.changed.slots)
        reaches_[slot] = rules.reaches[slot];
    }
    input_.rules.reaches = reaches_;
    new_filters_.clear();
    if (rules.all_changed) {
      new_filters_.assign(rules.filters.begin(), rules.filters.end());
    } else {
      for (const std::uint32_t slot : rules.refiltered) new_filters_.push_back(rules.filters[slot]);
      const std::size_t known = std::min(filters_.size(), rules.filters.size());
      new_filters_.insert(new_filters_.end(), rules.filters.begin() + static_cast<std::ptrdiff_t>(known),
                          rules.filters.end());
    }
    if (rules.are_exclusions_new()) new_exclusions_.assign(rules.exclusions.begin(), rules.exclusions.end());
  }

  Delta finish() override try {
    if (!input_.changed.all) keep_known(input_.for_tree().changed);
    const bool are_known = std::exchange(are_known_, true);
    read_.clear();
    take_filters();
    if (!input_.changed.all && finder_->find_changed(input_, found_)) {
      subtract(found_, exclusions_);
      if (!are_known) find_known();
      Delta delta = changes_from(known_);
      refuse_too_many(pairs_.size() + delta.added.size() - delta.removed.size());
      pairs_.change(delta.added, delta.removed);
      lists_.commit();
      has_found_all_ = false;
      return delta;
    }
    finder_->find(input_, found_);
    subtract(found_, exclusions_);
    Delta delta = changes_from(pairs_.all());
    pairs_.swap(found_);
    lists_.commit();
    has_found_all_ = true;
    return delta;
  } catch (...) {
    clear();
    throw;
  }

  void shrink(std::size_t slots) override {
    boxes_.shrink(slots);
    filters_.resize(std::min(filters_.size(), slots));  // the caller forgets those of free slots beyond
    filters_.shrink_to_fit();
    reaches_.resize(std::min(reaches_.size(), slots));
    reaches_.shrink_to_fit();
    exclusions_.shrink_to_fit();
    pairs_.shrink();
    lists_.clear();
    clear();
    give_back_free_memory();
  }

  [[nodiscard]] std::vector<Pair> find_all(const Input& input) override {
    std::vector<Pair> pairs;
    finder_->find(input, pairs);
    subtract(pairs, input.rules.exclusions);
    return pairs;
  }

  [[nodiscard]] BoxTree* tree() noexcept override { return finder_->tree(); }
  void read(const Input& input) override {
    read_.reserve(read_.size() + input.changed.slots.size());
    keep_known(input.changed);
    if (!filters_.empty()) filters_.resize(std::max(filters_.size(), input.boxes.size()));  // of the tree
    if (are_known_) {
      read_.insert(read_.end(), input.changed.slots.begin(), input.changed.slots.end());
      std::ranges::sort(read_);
      read_.erase(std::unique(read_.begin(), read_.end()), read_.end());
    }
    finder_->tree()->read(input);
  }

  /// Does not know how many boxes overlap, which can change the time several times over.
  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t changed) const override {
    return 5e-6 + std::min(600e-9 * static_cast<double>(changed), 150e-9 * static_cast<double>(slots));
  }

  [[nodiscard]] Touching touching(AxisSet axes) override {
    const std::span<const Pair> pairs = has_found_all_ ? pairs_.all() : found_;
    return {.all = has_found_all_, .pairs = touching_pairs(pairs, boxes(), reaches_, axes, threads_)};
  }
  [[nodiscard]] std::vector<Pair> pairs() override { return copy_of(pairs_.all()); }
  [[nodiscard]] const Device* device() const noexcept override { return nullptr; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return {}; }

 private:
  /// @param before Pairs of the last update, to be compared with those that were found.
  Delta changes_from(std::span<const Pair> before) {
    return lists_.fill([&](std::vector<Pair>& added, std::vector<Pair>& removed) {
      compare(before, found_, input_.changed.recycled, parts_, added, removed);
    });
  }

  /// Finds the pairs of some slots as of the last update, with its filters and exclusions, before the finder
  /// reads what changed there: unless this takes longer than to look at all pairs in finish().
  void keep_known(const SlotChanges& unread) {
    const std::size_t time_to_search =
        unread.slots.size() * pairs_per_search + known_.size() * pairs_per_found;  // as the last time
    const bool may_be_known = std::exchange(are_known_, false) && !unread.all;
    if (!may_be_known || time_to_search >= pairs_.size() ||
        !finder_->find_known(filters_, unread.slots, found_))
      return;
    subtract(found_, exclusions_);
    if (read_.empty()) {
      known_.swap(found_);
    } else {  // whose pairs were found before they were read
      const SlotSet read(read_);
      std::erase_if(found_, [&](const Pair& pair) { return read.contains(pair.a) || read.contains(pair.b); });
      known_ = merge(known_, found_);
    }
    are_known_ = true;
  }

  /// Frees what is not needed before the next update, which searches all boxes.
  void clear() noexcept {
    finder_->clear();
    are_known_ = true;
    pairs_.free_scratch();
    parts_.free_scratch();
    free_lists(found_, known_, read_, has_changed_, new_filters_, new_exclusions_);
  }

  /// Makes the filters and exclusions those of this update.
  void take_filters() {
    PairRules& rules = input_.rules;
    if (rules.are_exclusions_new()) exclusions_.swap(new_exclusions_);
    if (rules.all_changed) {
      filters_.swap(new_filters_);
    } else {
      const std::size_t known = std::min(filters_.size(), rules.filters.size());
      filters_.resize(rules.filters.size());
      const auto first_unknown = new_filters_.begin() + static_cast<std::ptrdiff_t>(rules.refiltered.size());
      std::copy(first_unknown, new_filters_.end(), filters_.begin() + static_cast<std::ptrdiff_t>(known));
      for (std::size_t k = 0; k < rules.refiltered.size(); ++k)
        filters_[rules.refiltered[k]] = new_filters_[k];
    }
    rules.filters = filters_;  // the caller's were for begin() only
  }

  /// The pairs of the last update that contain a slot that changed.
  void find_known() {
    std::size_t slots = input_.boxes.size();
    for (const std::uint32_t slot : input_.changed.slots) slots = std::max<std::size_t>(slots, slot + 1);
    const std::vector<Pair>& pairs = pairs_.all();
    if (!pairs.empty()) slots = std::max<std::size_t>(slots, pairs.back().b + 1);
    has_changed_.assign(slots, 0);
    for (const std::uint32_t slot : input_.changed.slots) has_changed_[slot] = 1;
    select_by_slots(pairs, has_changed_, parts_, known_);
  }

  std::unique_ptr<HostFinder> finder_;
  Threads threads_;  // at most; 0 for one per processor
  KeptBoxes<Aabb> boxes_;
  std::vector<Filter> filters_;  // as of the last update, and so are the exclusions
  std::vector<Pair> exclusions_;
  std::vector<float> reaches_;  // of this update
  Input input_;
  // Of this update: all filters, or those that changed, followed by those that are beyond the last ones.
  std::vector<Filter> new_filters_;
  std::vector<Pair> new_exclusions_;
  ChangingPairs pairs_;  // as of the last update
  PairParts parts_;
  ChangeLists lists_;
  std::vector<Pair> found_, known_;
  bool are_known_ = true;            // the known pairs of slots that have been read since the last update
  std::vector<std::uint32_t> read_;  // these, ascending, as long as they are known
  bool has_found_all_ = true;        // in the last update, not only the pairs of what changed
  std::vector<std::uint8_t> has_changed_;  // by slot
};

}  // namespace

AlgorithmPointer make_host_engine(std::unique_ptr<HostFinder> finder, const Threads& threads) {
  return std::make_unique<HostEngine>(std::move(finder), threads);
}

}  // namespace broadcl
