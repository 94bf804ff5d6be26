#pragma once

#include <BulletCollision/BroadphaseCollision/btBroadphaseProxy.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace broadcl {

/// A proxy, and what the adapter remembers of it.
struct Proxy : btBroadphaseProxy {
  Proxy() {
    m_uniqueId = no_id;
    m_collisionFilterGroup = 0;
    m_collisionFilterMask = 0;
  }

  static constexpr int no_id = -1;  ///< Of a slot that is free.

  [[nodiscard]] bool is_live() const noexcept { return m_uniqueId != no_id; }
  [[nodiscard]] std::uint32_t id() const noexcept { return static_cast<std::uint32_t>(m_uniqueId); }

  // Users write m_collisionFilterGroup and m_collisionFilterMask in place: these are the values last seen.
  int seen_group = 0;
  int seen_mask = 0;
  std::uint32_t created = 0;  ///< Number of calculations before it was created.
  std::uint32_t changed = 0;  ///< Number of calculations before its box or filter was last changed.
};

/// Proxies by id. They lie together, so that looking at all of them is quick, and never move.
class ProxyPool {
 public:
  /// The slot of an id, which it makes where there is none.
  Proxy& make(std::uint32_t id) {
    while (id >= chunks_.size() * chunk_size) chunks_.push_back(std::make_unique<Chunk>());
    return (*this)[id];
  }

  [[nodiscard]] Proxy& operator[](std::uint32_t id) const {
    return (*chunks_[id / chunk_size])[id % chunk_size];
  }

  /// Free slots too.
  template <class Function>
  void for_each_slot(Function&& function) const {
    for (const auto& chunk : chunks_) {
      for (Proxy& proxy : *chunk) function(proxy);
    }
  }

  template <class Function>
  void for_each(Function&& function) const {
    for_each_slot([&](Proxy& proxy) {
      if (proxy.is_live()) function(proxy);
    });
  }

 private:
  static constexpr std::size_t chunk_size = 256;
  using Chunk = std::array<Proxy, chunk_size>;
  std::vector<std::unique_ptr<Chunk>> chunks_;
};

}  // namespace broadcl
