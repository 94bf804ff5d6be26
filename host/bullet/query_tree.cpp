#include "bullet/query_tree.hpp"

#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "base/non_copyable.hpp"

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

/// Nodes for a btDbvt, which itself does not notice if Bullet's allocator returns null.
class Nodes : NonCopyable {
 public:
  ~Nodes() {
    for (btDbvtNode* node : nodes_) btAlignedFree(node);
  }

  /// @throws std::bad_alloc
  void allocate(std::size_t count) {
    nodes_.reserve(nodes_.size() + count);
    for (; count > 0; --count) {
      void* const memory = btAlignedAlloc(sizeof(btDbvtNode), 16);
      if (memory == nullptr) throw std::bad_alloc();
      nodes_.push_back(new (memory) btDbvtNode());
    }
  }

  /// A leaf that the caller owns.
  btDbvtNode& leaf(const btDbvtVolume& box, Proxy& proxy) noexcept {
    btDbvtNode& node = take();
    node.volume = box;
    node.childs[1] = nullptr;
    node.data = &proxy;
    return node;
  }

  /// The parent of two nodes, likewise.
  btDbvtNode& parent(btDbvtNode& s, btDbvtNode& t) noexcept {
    btDbvtNode& node = take();
    Merge(s.volume, t.volume, node.volume);
    node.childs[0] = &s;
    node.childs[1] = &t;
    s.parent = t.parent = &node;
    return node;
  }

 private:
  btDbvtNode& take() noexcept {
    btDbvtNode& node = *nodes_.back();
    nodes_.pop_back();
    node.parent = nullptr;
    return node;
  }

  std::vector<btDbvtNode*> nodes_;
};

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
btDbvtNode& join(std::span<Sortable> leaves, Nodes& nodes) noexcept {
  if (leaves.size() == 1) return *leaves.front().leaf;
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
  return nodes.parent(join(leaves.first(half), nodes), join(leaves.subspan(half), nodes));
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
  Nodes nodes;
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
      nodes.allocate(2);
      node.leaf = &nodes.leaf(box, proxy);
      btDbvtNode* const root = tree_.m_root;
      tree_.m_root = root == nullptr ? node.leaf : &nodes.parent(*root, *node.leaf);
      ++tree_.m_leaves;
      tree_.update(node.leaf, box);  // moves it from below the root to its place
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
  Nodes nodes;
  nodes.allocate(2 * nodes_.size());
  for (const std::uint32_t id : stale_) nodes_[id].is_stale = false;
  stale_.clear();
  scanned_ = 0;
  tree_.clear();
  for (Node& node : nodes_) node.leaf = nullptr;
  pool_.for_each([&](Proxy& proxy) {
    if (!is_proper(proxy)) return;
    btDbvtNode& leaf = nodes.leaf(btDbvtVolume::FromMM(proxy.m_aabbMin, proxy.m_aabbMax), proxy);
    nodes_[proxy.id()].leaf = &leaf;
    leaves.emplace_back(leaf);
  });
  if (!leaves.empty()) tree_.m_root = &join(leaves, nodes);
  tree_.m_leaves = static_cast<int>(leaves.size());  // clear() does not reset it
}

}  // namespace broadcl
