#include "scenes/box_world.hpp"

#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "scenes/remove_all_pairs.hpp"
#include "scenes/timed_frame.hpp"

namespace broadcl::scenes {
namespace {

btVector3 to_bullet(const std::array<float, 3>& corner) {
  return {corner[0], corner[1], corner[2]};
}

/// The filter of a new object.
Filter first_filter(const RecordedFrame& frame, std::uint32_t id) {
  const auto found = std::ranges::lower_bound(frame.filters, id, {}, &RecordedFrame::Of<Filter>::id);
  return found != frame.filters.end() && found->id == id ? found->value : Filter();
}

}  // namespace

BoxWorld::~BoxWorld() {
  remove_all_pairs(*broadphase_.getOverlappingPairCache(), nullptr);
  for (btBroadphaseProxy* proxy : proxies_) broadphase_.destroyProxy(proxy, nullptr);
}

void BoxWorld::set(const RecordedFrame& frame) {
  for (const auto& [id, filter] : frame.filters) {
    const auto old = std::ranges::lower_bound(ids_, id);
    if (old == ids_.end() || *old != id || std::ranges::binary_search(frame.gone, id)) continue;
    btBroadphaseProxy*& proxy = proxies_[static_cast<std::size_t>(old - ids_.begin())];
    broadphase_.destroyProxy(proxy, nullptr);
    proxy = create(frame.boxes[frame.row_of(id)], filter);
  }
  if (!frame.gone.empty() || !frame.added.empty()) exchange(frame);
  for (std::size_t k = 0; k < proxies_.size(); ++k) {
    broadphase_.setAabb(proxies_[k], to_bullet(frame.boxes[k].lower), to_bullet(frame.boxes[k].upper),
                        nullptr);
  }
}

btBroadphaseProxy* BoxWorld::create(const Aabb& box, const Filter& filter) {
  void* const owner = this;  // btSimpleBroadphase skips proxies that have no client object
  return broadphase_.createProxy(to_bullet(box.lower), to_bullet(box.upper), 0, owner,
                                 static_cast<int>(filter.group), static_cast<int>(filter.mask), nullptr);
}

/// Destroys and creates proxies.
void BoxWorld::exchange(const RecordedFrame& frame) {
  std::vector<btBroadphaseProxy*> proxies(frame.ids.size());
  for (std::size_t k = 0; k < ids_.size(); ++k) {
    if (std::ranges::binary_search(frame.gone, ids_[k])) {
      broadphase_.destroyProxy(proxies_[k], nullptr);
    } else {
      proxies[frame.row_of(ids_[k])] = proxies_[k];
    }
  }
  for (const std::uint32_t id : frame.added) {
    const std::size_t row = frame.row_of(id);
    proxies[row] = create(frame.boxes[row], first_filter(frame, id));
  }
  ids_ = frame.ids;
  proxies_ = std::move(proxies);
}

FrameTimes BoxWorld::step(const RecordedFrame& frame) {
  return timed_frame([&] { set(frame); }, [&] { broadphase_.calculateOverlappingPairs(nullptr); });
}

Difference BoxWorld::verify(std::span<const Aabb> boxes) {
  return scenes::verify(*broadphase_.getOverlappingPairCache(), proxies_, boxes);
}

}  // namespace broadcl::scenes
