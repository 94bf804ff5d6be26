#pragma once

#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <cstddef>
#include <cstdint>
#include <new>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>
#include <broadcl/bullet.hpp>

#include "base/pair_lists.hpp"
#include "bullet/filter_watch.hpp"
#include "bullet/proxy_pool.hpp"
#include "bullet/reports.hpp"
#include "core/tree_access.hpp"

namespace broadcl {

/// Finds the pairs of overlapping proxies whose filters allow it, with a core that has a copy of every box
/// and filter.
///
/// If the device fails, a core on the host takes over for good. If memory is exhausted, the copy may be out
/// of date; the next find() copies all proxies again.
class ProxySearch {
 public:
  using Core = BulletBroadphase::Core;

  /// @param cache, pool, reports Must outlive this object.
  ProxySearch(const Config& config, btOverlappingPairCache& cache, ProxyPool& pool, Reports& reports)
      : core_(config),
        on_host_{.algorithm = "sweep-and-prune", .threads = config.threads, .executor = config.executor},
        pool_(pool),
        filters_(cache, pool),
        reports_(reports) {}

  /// @param proxy Not in the pool yet.
  /// @returns Its id.
  /// @throws std::bad_alloc; then nothing has changed.
  std::uint32_t add(const Proxy& proxy) {
    is_late_ = true;
    return on_core([&] { return core_.add(box_of(proxy), filters_.filter(masks_of(proxy))); });
  }

  void move(std::uint32_t id, const ProxyBox& box) {
    is_late_ = true;
    attempt([&] { on_core([&] { core_.move(id, box); }); });
  }

  /// @throws std::bad_alloc if memory is exhausted repeatedly; then nothing has changed.
  void remove(std::uint32_t id) {
    is_late_ = true;
    if (attempt([&] { on_core([&] { core_.remove(id); }); })) return;
    // It needs memory only during an update, which this ends, even if it fails.
    attempt([&] { on_core([&] { core_.finish(); }); });
    core_.remove(id);
  }

  /// As BulletBroadphase::begin().
  void begin() {
    if (is_begun_ || is_lost_) return;
    give_filters();
    on_core([&] { core_.begin(); });
    is_begun_ = true;
    is_late_ = false;
  }

  struct Found {
    Delta delta;                           ///< Since the last calculation.
    std::optional<std::vector<Pair>> all;  ///< All pairs, if they were asked for or there is no delta.
  };

  /// The pairs for the current boxes and filters; valid until the next call.
  /// @throws std::bad_alloc
  Found find(bool all_too) {
    give_filters();
    return on_core([&] {
      if (is_lost_) {
        end_update();
        fill(core_);
      }
      Found found{.delta = core_.finish(), .all = std::nullopt};
      if (is_begun_ && is_late_) found.delta = update_again(found.delta);
      if (all_too || must_compare_ || must_decide_again_) found.all = core_.pairs();
      return found;
    });
  }

  /// Whether find() can search. Otherwise all proxies are to be tested.
  [[nodiscard]] bool has_tree() const {
    try {
      return !is_lost_ && detail::TreeAccess<ProxyBox>::has_all(core_);
    } catch (const std::bad_alloc&) {
      return false;
    } catch (const Error&) {  // The next calculation meets it, too, and reports it.
      return false;
    }
  }
  void find(RankedSearch<ProxyBox>& search) const { detail::TreeAccess<ProxyBox>::find(core_, search); }

  /// Whether the cache is to decide about all pairs again.
  [[nodiscard]] bool must_decide_again() const noexcept { return must_decide_again_; }

  /// Call this when the cache has what was found.
  void end_calculation() noexcept { is_begun_ = is_lost_ = must_compare_ = must_decide_again_ = false; }

  /// Calls a function. If that runs out of memory, the next find() copies all proxies again.
  /// @returns Whether it succeeded.
  template <class Function>
  bool attempt(const Function& function) {
    try {
      function();
      return true;
    } catch (const std::bad_alloc&) {
      must_compare_ = true;
      if (!std::exchange(is_lost_, true)) {
        reports_.tell(
            {"memory is exhausted; pairs may be missing or outdated until a calculation has enough memory, ",
             "which then compares all of them"});
      }
      return false;
    }
  }

  [[nodiscard]] const Core& core() const noexcept { return core_; }

 private:
  /// Calls a function that uses the core. If the device fails, a core on the host replaces the core for good,
  /// and the function is called again.
  template <class Function>
  std::invoke_result_t<Function> on_core(const Function& function) {
    try {
      return function();
    } catch (const Error& error) {
      if (!core_.algorithm().on_device) throw;  // (`auto` may have left the device already)
      Core host(on_host_);
      fill(host);
      core_ = std::move(host);
      must_compare_ = true;
      reports_.tell({error.what(), "; from now on pairs are found on the host, by sweep and prune"});
    }
    return function();
  }

  /// Ends an update that was begun, which may have too many pairs for the memory.
  void end_update() {
    if (!is_begun_) return;
    attempt([&] { core_.finish(); });
    is_begun_ = false;
  }

  /// Copies all boxes and filters to a core. If that fails, the core either has the right ids, or is
  /// unchanged.
  void fill(Core& core) const {
    std::size_t slots = 0;
    pool_.for_each([&](const Proxy& proxy) { slots = std::size_t{proxy.id()} + 1; });
    const std::span<ProxyBox> boxes = core.map(slots);
    pool_.for_each([&](const Proxy& proxy) { boxes[proxy.id()] = box_of(proxy); });
    for (std::uint32_t id = 0; id < slots; ++id) {
      if (!pool_[id].is_live()) core.remove(id);
    }
    pool_.for_each(
        [&](const Proxy& proxy) { core.set_filter(proxy.id(), filters_.filter(pool_.seen(proxy.id()))); });
  }

  void give_filters() {
    must_decide_again_ |= filters_.look([this](const Proxy& proxy) {
      is_late_ = true;
      attempt([&] { on_core([&] { core_.set_filter(proxy.id(), filters_.filter(masks_of(proxy))); }); });
    });
  }

  /// Does a second update.
  /// @param first The changes of the first update.
  /// @returns The changes of both updates together.
  Delta update_again(const Delta& first) {
    const Delta second = core_.update();
    added_ = merge(difference(first.added, second.removed), second.added);
    removed_ = merge(first.removed, difference(second.removed, first.added));
    // A pair that was removed and added again has stayed, unless one of its ids was reused.
    std::vector<Pair> back = intersection(added_, removed_);
    std::erase_if(back, [&](const Pair& pair) { return !pool_.is_known(pair); });
    subtract(added_, back);
    subtract(removed_, back);
    return {.added = added_, .removed = removed_};
  }

  Core core_;
  Config on_host_;  // of the core that takes over
  ProxyPool& pool_;
  FilterWatch filters_;
  Reports& reports_;
  bool is_begun_ = false;              // the next calculation
  bool is_late_ = false;               // something changed after it began
  bool is_lost_ = false;               // the core may have other boxes and filters than the proxies
  bool must_compare_ = false;          // the core may not know the pairs of the last calculation
  bool must_decide_again_ = false;     // the callback is another one than at the last calculation
  std::vector<Pair> added_, removed_;  // by two updates together
};

}  // namespace broadcl
