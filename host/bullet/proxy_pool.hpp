#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "bullet/proxy.hpp"

namespace broadcl {

/// Proxies by id. They lie together, so that looking at all of them is quick, and never move.
class ProxyPool {
 public:
  /// The slot of an id, which it makes where there is none.
  Proxy& make(std::uint32_t id) {
    while (id >= slots()) chunks_.push_back(std::make_unique<Chunk>());
    return (*this)[id];
  }

  [[nodiscard]] Proxy& operator[](std::uint32_t id) const {
    return (*chunks_[id / chunk_size])[id % chunk_size];
  }

  /// Number of slots, free ones too.
  [[nodiscard]] std::size_t slots() const noexcept { return chunks_.size() * chunk_size; }

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
