#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <shared_mutex>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/box_view.hpp>
#include <broadcl/query.hpp>

#include "base/slot_set.hpp"
#include "base/threads.hpp"
#include "core/core.hpp"
#include "core/query_batch.hpp"

namespace broadcl {

/// Queries of the objects of a core. Several threads may ask at the same time, but not while objects change.
template <class Box>
class Queries {
 public:
  using Bound = BoundType<Box>;

  /// @param core Must outlive this object.
  /// @param threads At most; 0 for one per processor.
  Queries(Core<Box>& core, Threads threads) : core_(core), threads_(std::move(threads)) {}

  /// As the functions of BasicBroadPhase.
  [[nodiscard]] Hits overlapping(const BoxView& boxes, const QueryOptions& options);
  std::size_t overlapping(const Box& box, std::vector<std::uint32_t>& ids, const QueryOptions& options);
  [[nodiscard]] Hits nearest(const BoxView& boxes, const QueryOptions& options);
  [[nodiscard]] Hits along(const BoxView& starts, std::span<const std::array<Bound, 3>> directions,
                           std::span<const Bound> lengths, const QueryOptions& options);
  [[nodiscard]] std::vector<std::uint32_t> partners(std::uint32_t id);

  /// As the functions of TreeAccess.
  [[nodiscard]] bool has_all() { return has_all_.load(std::memory_order_acquire) || read_all(); }
  void find(RankedSearch<Box>& search) const {
    search.map = core_.map_of_boxes();
    tree_->find(search);
  }

  /// To be called before an update begins: if queries were asked during the last one, they will be now, so
  /// what changed is read first.
  void prepare_begin();
  void prepare_finish() noexcept { are_asked_in_flight_ = is_current_ || has_all_ || scanned_ > 0; }
  /// To be called before objects change.
  void forget_boxes() noexcept { is_current_ = has_all_ = false; }
  /// To be called before the pairs may change, too.
  void forget_pairs() noexcept {
    forget_boxes();
    has_pairs_ = false;
    scanned_ = 0;
  }
  void shrink() noexcept;

 private:
  template <class Function>
  auto with_current(std::size_t queries, const Function& function);
  Hits answer(std::size_t queries, const std::function<Hits(const Searched<Box>&)>& search);
  [[nodiscard]] std::size_t unread_count() const noexcept { return unread_ ? unread_->size() : slots_; }
  [[nodiscard]] bool must_read(std::size_t queries) const noexcept;
  void find_unread(std::size_t queries);
  bool read_all();
  void index_pairs();

  Core<Box>& core_;
  Threads threads_;
  std::shared_mutex mutex_;  // of what follows, and of the core
  bool is_current_ = false;
  std::atomic<bool> has_all_ = false;
  std::size_t slots_ = 0;  // of the core
  const BoxTree* tree_ = nullptr;
  std::optional<std::vector<std::uint32_t>>
      unread_;  // ids whose boxes are not in the tree; none if it has none
  SlotSet unread_set_{{}};
  std::atomic<std::size_t> scanned_ = 0;  // boxes that were tested one by one
  bool are_asked_in_flight_ = false;
  bool has_pairs_ = false;
  std::vector<Pair> pairs_;
  std::vector<std::uint32_t> first_larger_;  // by id + 1: the first of its larger partners
  std::vector<std::uint32_t> larger_;
};

}  // namespace broadcl
