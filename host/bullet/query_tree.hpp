#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btDbvt.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <new>
#include <random>
#include <vector>

#include "bullet/proxy_pool.hpp"

namespace broadcl {

/// Answers ray and box queries with a tree of the proxies' boxes, which is updated only if that pays off:
/// queries scan all proxies until the scans of a frame have cost about as much as an update of the tree, or
/// less if the tree has to be built anew.
///
/// Queries may run in several threads at the same time, and within one another, but not at the same time as
/// other functions. Empty boxes are never found. If there is no memory for the tree, queries scan.
class QueryTree {
 public:
  /// @param pool All proxies; must outlive this object.
  explicit QueryTree(const ProxyPool& pool) : pool_(pool) {}

  /// To be called after a proxy was created, destroyed or got another box.
  void touch(std::uint32_t id) noexcept {
    if (!is_in_use_) return;
    is_current_.store(false, std::memory_order_relaxed);
    try {
      if (id >= nodes_.size()) nodes_.resize(id + 1);
      if (nodes_[id].is_stale) return;
      stale_.push_back(id);
      nodes_[id].is_stale = true;
    } catch (const std::bad_alloc&) {
      give_up();
    }
  }

  /// Resets the count of scans.
  void start_frame() noexcept { scanned_ = 0; }

  /// As btBroadphaseInterface::rayTest().
  void ray_test(const btVector3& from, btBroadphaseRayCallback& callback, const btVector3& lower,
                const btVector3& upper);

  /// As btBroadphaseInterface::aabbTest().
  void aabb_test(const btVector3& lower, const btVector3& upper, btBroadphaseAabbCallback& callback);

 private:
  struct Node {
    btDbvtNode* leaf = nullptr;  // owned by the tree
    bool is_stale = false;
  };

  /// Counts a query, and updates the tree if that pays off. Returns whether the tree is up to date.
  bool is_current();
  void update();
  /// Whether so many boxes are new or have moved that the update builds the tree anew.
  [[nodiscard]] bool must_rebuild() const noexcept;
  /// How many proxies the queries of a frame scan before the tree is updated.
  [[nodiscard]] std::size_t scans_before_update() const noexcept;
  /// Much faster than to remove and insert all boxes, and balanced.
  void rebuild();
  /// Discards the tree because memory is exhausted: the next query starts with an empty one.
  void give_up() noexcept {
    tree_.clear();
    nodes_.clear();
    stale_.clear();
    is_in_use_ = false;
  }

  const ProxyPool& pool_;
  btDbvt tree_;
  std::vector<Node> nodes_;           // by id
  std::vector<std::uint32_t> stale_;  // in any order
  std::minstd_rand random_;           // NOLINT(cert-msc51-cpp): always the same numbers
  std::size_t scanned_ = 0;           // proxies in this frame
  bool is_in_use_ = false;            // from the first query on
  std::atomic<bool> is_current_ = false;
  std::mutex mutex_;  // of all the above, while queries run
};

}  // namespace broadcl
