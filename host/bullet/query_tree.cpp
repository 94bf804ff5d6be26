#include "bullet/query_tree.hpp"

#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

namespace broadcl {
namespace {

/// Removing a box from the tree and inserting it again costs as much as scanning this many boxes.
constexpr std::size_t scans_per_update = 50;

/// Building the tree anew costs 10 to 25 scans per box. But a frame with some queries mostly has many, and a
/// btDbvtBroadphase has paid more before the first one.
constexpr std::size_t scans_per_rebuilt_box = 5;

/// If leaves that are inserted lie deeper than this on average, many boxes are equal.
constexpr std::size_t most_depth = 64;

std::size_t depth(const btDbvtNode* node) {
  std::size_t levels = 0;
  for (; node->parent != nullptr; node = node->parent) ++levels;
  return levels;
}

/// A leaf, and where to sort it.
struct Sortable {
  explicit Sortable(btDbvtNode& node) : leaf(&node) {
    const btVector3 center = node.volume.Center();
    for (int axis = 0; axis < 3; ++axis) {
      place[axis] = std::isnan(center[axis]) ? 0 : center[axis];  // if it has no end on both sides
    }
  }

  btVector3 place;
  btDbvtNode* leaf;
};

/// Joins leaves to a balanced tree, whatever their boxes are, and returns its root.
btDbvtNode* join(std::span<Sortable> leaves) {
  if (leaves.size() == 1) return leaves.front().leaf;
  btVector3 lower = leaves.front().place;
  btVector3 upper = lower;
  for (const Sortable& leaf : leaves) {
    lower.setMin(leaf.place);
    upper.setMax(leaf.place);
  }
  const int axis = (upper - lower).maxAxis();
  const std::size_t half = leaves.size() / 2;
  std::ranges::nth_element(leaves, leaves.begin() + static_cast<std::ptrdiff_t>(half), {},
                           [axis](const Sortable& leaf) { return leaf.place[axis]; });
  auto* const node = new (btAlignedAlloc(sizeof(btDbvtNode), 16)) btDbvtNode();
  node->parent = nullptr;
  node->childs[0] = join(leaves.first(half));
  node->childs[1] = join(leaves.subspan(half));
  for (btDbvtNode* child : node->childs) child->parent = node;
  Merge(node->childs[0]->volume, node->childs[1]->volume, node->volume);
  return node;
}

/// Passes the leaves that the tree finds to a callback.
class Report final : public btDbvt::ICollide {
 public:
  explicit Report(btBroadphaseAabbCallback& callback) : callback_(callback) {}

  using ICollide::Process;
  void Process(const btDbvtNode* leaf) override {
    callback_.process(static_cast<const btBroadphaseProxy*>(leaf->data));
  }

 private:
  btBroadphaseAabbCallback& callback_;
};

}  // namespace

void QueryTree::ray_test(const btVector3& from, btBroadphaseRayCallback& callback, const btVector3& lower,
                         const btVector3& upper) {
  if (is_current()) {
    Report report(callback);
    // The tree's own would be shared by all queries.
    btAlignedObjectArray<const btDbvtNode*> stack;
    std::array<const btDbvtNode*, btDbvt::DOUBLE_STACKSIZE> memory;
    stack.initializeFromBuffer(memory.data(), 0, btDbvt::DOUBLE_STACKSIZE);
    tree_.rayTestInternal(tree_.m_root, from, from, callback.m_rayDirectionInverse, callback.m_signs,
                          callback.m_lambda_max, lower, upper, stack, report);
    return;
  }
  pool_.for_each([&](const Proxy& proxy) {
    const std::array bounds{proxy.m_aabbMin - upper, proxy.m_aabbMax - lower};
    btScalar hit = 1;
    if (is_proper(proxy) && btRayAabb2(from, callback.m_rayDirectionInverse, callback.m_signs, bounds.data(),
                                       hit, 0, callback.m_lambda_max)) {
      callback.process(&proxy);
    }
  });
}

void QueryTree::aabb_test(const btVector3& lower, const btVector3& upper,
                          btBroadphaseAabbCallback& callback) {
  if (is_current()) {
    Report report(callback);
    tree_.collideTV(tree_.m_root, btDbvtVolume::FromMM(lower, upper), report);
    return;
  }
  pool_.for_each([&](const Proxy& proxy) {
    const bool is_found = overlaps(proxy.m_aabbMin, proxy.m_aabbMax, lower, upper);
    if (is_found && is_proper(proxy)) callback.process(&proxy);
  });
}

bool QueryTree::is_current() {
  if (is_current_.load(std::memory_order_acquire)) return true;
  const std::lock_guard lock(mutex_);
  if (is_current_.load(std::memory_order_relaxed)) return true;
  if (!is_in_use_) {
    is_in_use_ = true;
    pool_.for_each([this](const Proxy& proxy) { touch(proxy.id()); });
  }
  scanned_ += pool_.slots();
  if (!is_in_use_ || scanned_ < scans_before_update()) return false;
  try {
    update();
  } catch (const std::bad_alloc&) {
    give_up();
    return false;
  }
  is_current_.store(true, std::memory_order_release);
  return true;
}

bool QueryTree::must_rebuild() const noexcept {
  return 2 * stale_.size() > static_cast<std::size_t>(tree_.m_leaves);
}

std::size_t QueryTree::scans_before_update() const noexcept {
  return must_rebuild() ? scans_per_rebuilt_box * nodes_.size() : scans_per_update * stale_.size();
}

void QueryTree::update() {
  if (must_rebuild()) {
    rebuild();
    return;
  }
  // If the objects of a row were inserted in order, the tree would be as deep as the row is long.
  std::shuffle(stale_.begin(), stale_.end(), random_);
  std::size_t levels = 0;
  for (const std::uint32_t id : stale_) {
    Node& node = nodes_[id];
    Proxy& proxy = pool_[id];
    btDbvtVolume box = btDbvtVolume::FromMM(proxy.m_aabbMin, proxy.m_aabbMax);
    const bool is_found = proxy.is_live() && is_proper(proxy);
    if (is_found && node.leaf != nullptr) {
      tree_.update(node.leaf, box);
    } else if (is_found) {
      node.leaf = tree_.insert(box, &proxy);
    } else if (node.leaf != nullptr) {
      tree_.remove(node.leaf);
      node.leaf = nullptr;
    }
    node.is_stale = false;
    if (node.leaf != nullptr) levels += depth(node.leaf);
    if (levels > most_depth * (stale_.size() + most_depth)) {
      rebuild();
      return;
    }
  }
  stale_.clear();
  scanned_ = 0;
}

void QueryTree::rebuild() {
  std::vector<Sortable> leaves;
  leaves.reserve(nodes_.size());
  for (const std::uint32_t id : stale_) nodes_[id].is_stale = false;
  stale_.clear();
  scanned_ = 0;
  tree_.clear();
  for (Node& node : nodes_) node.leaf = nullptr;
  pool_.for_each([&](Proxy& proxy) {
    if (!is_proper(proxy)) return;
    tree_.m_root = nullptr;  // each leaf is a tree at first
    btDbvtNode* const leaf = tree_.insert(btDbvtVolume::FromMM(proxy.m_aabbMin, proxy.m_aabbMax), &proxy);
    nodes_[proxy.id()].leaf = leaf;
    leaves.emplace_back(*leaf);
  });
  tree_.m_root = leaves.empty() ? nullptr : join(leaves);
  tree_.m_leaves = static_cast<int>(leaves.size());  // clear() does not reset it
}

}  // namespace broadcl
