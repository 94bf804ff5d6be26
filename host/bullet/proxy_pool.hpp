#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include <broadcl/pair.hpp>

#include "base/prefetch.hpp"
#include "bullet/proxy.hpp"

namespace broadcl {

/// Proxies by id, and which of them are new or changed since the last calculation. They are stored
/// contiguously in chunks, so that reading all of them is quick, and never move. The last known masks are
/// stored next to them.
class ProxyPool {
 public:
  /// @param last_number Calculations are numbered from 1 to this, and then again.
  explicit ProxyPool(std::uint32_t last_number = std::numeric_limits<std::uint32_t>::max())
      : last_number_(last_number) {}

  /// Makes slots for all ids below n.
  void reserve(std::size_t n) {
    while (slots() < n) chunks_.push_back(std::make_unique<Chunk>());
  }

  [[nodiscard]] Proxy& operator[](std::uint32_t id) const {
    return chunks_[id / chunk_size]->proxies[id % chunk_size];
  }
  [[nodiscard]] Masks& seen(std::uint32_t id) const {
    return chunks_[id / chunk_size]->seen[id % chunk_size];
  }

  /// Number of slots, including free ones.
  [[nodiscard]] std::size_t slots() const noexcept { return chunks_.size() * chunk_size; }

  template <class Function>
  void for_each(Function&& function) const {
    for (const auto& chunk : chunks_) {
      for (Proxy& proxy : chunk->proxies) {
        if (proxy.is_live()) function(proxy);
      }
    }
  }

  /// Calls function(proxy) with each proxy whose masks have changed since the last call.
  template <class Function>
  void for_each_written(Function&& function) const {
    for (std::size_t c = 0; c < chunks_.size(); ++c) {
      Chunk& chunk = *chunks_[c];
      // The processor's own prefetching does not look far enough ahead.
      const Chunk& next = *chunks_[std::min(c + 4, chunks_.size() - 1)];
      for (std::size_t k = 0; k < chunk_size; ++k) {
        prefetch(&next.proxies[k]);
        if (k % 8 == 0) prefetch(&next.seen[k]);
        Proxy& proxy = chunk.proxies[k];
        if (masks_of(proxy) == chunk.seen[k] || !proxy.is_live()) continue;
        chunk.seen[k] = masks_of(proxy);
        function(proxy);
      }
    }
  }

  void mark_created(Proxy& proxy) noexcept {
    proxy.created = last_renewal_ = next_calculation_;
    mark_changed(proxy);
  }
  /// Records that its box or filter changed.
  void mark_changed(Proxy& proxy) noexcept { proxy.changed = last_change_ = next_calculation_; }
  void free(Proxy& proxy) noexcept {
    seen(proxy.id()) = {};
    proxy = Proxy();
    last_renewal_ = next_calculation_;
  }
  void end_calculation() noexcept {
    if (next_calculation_++ < last_number_) return;
    next_calculation_ = 1;
    last_change_ = last_renewal_ = 0;
    for_each([](Proxy& proxy) { proxy.created = proxy.changed = 0; });
  }

  /// Whether both proxies already existed at the last calculation.
  [[nodiscard]] bool is_known(const Pair& pair) const { return is_known(pair.a) && is_known(pair.b); }
  /// Whether all ids belong to the same proxies as at the last calculation.
  [[nodiscard]] bool are_all_known() const noexcept { return last_renewal_ != next_calculation_; }
  [[nodiscard]] bool is_changed(const Pair& pair) const {
    return (*this)[pair.a].changed == next_calculation_ || (*this)[pair.b].changed == next_calculation_;
  }
  [[nodiscard]] bool is_any_changed() const noexcept { return last_change_ == next_calculation_; }

 private:
  static constexpr std::size_t chunk_size = 16;  // so that a few proxies cost little
  struct Chunk {
    std::array<Proxy, chunk_size> proxies;
    std::array<Masks, chunk_size> seen;
  };

  [[nodiscard]] bool is_known(std::uint32_t id) const {
    return (*this)[id].is_live() && (*this)[id].created != next_calculation_;
  }

  std::vector<std::unique_ptr<Chunk>> chunks_;
  std::uint32_t last_number_;           // of a calculation; numbers then start again
  std::uint32_t next_calculation_ = 1;  // its number
  std::uint32_t last_change_ = 0;       // the calculation before which a proxy was last changed
  std::uint32_t last_renewal_ = 0;      // and created or destroyed
};

}  // namespace broadcl
