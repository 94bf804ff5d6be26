#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <broadcl/pair.hpp>

#include "bullet/proxy.hpp"

namespace broadcl {

/// Proxies by id, and which of them are new or changed since the last calculation. They are stored together,
/// so that looking at all of them is quick, and never move.
class ProxyPool {
 public:
  /// Creates the slots of all ids below n.
  void reserve(std::size_t n) {
    while (slots() < n) chunks_.push_back(std::make_unique<Chunk>());
  }

  [[nodiscard]] Proxy& operator[](std::uint32_t id) const {
    return (*chunks_[id / chunk_size])[id % chunk_size];
  }

  /// Number of slots, including free ones.
  [[nodiscard]] std::size_t slots() const noexcept { return chunks_.size() * chunk_size; }

  /// Including free slots.
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

  void mark_created(Proxy& proxy) noexcept {
    proxy.created = last_id_change_ = next_calculation_;
    mark_changed(proxy);
  }
  /// Its box or filter changed.
  void mark_changed(Proxy& proxy) noexcept { proxy.changed = last_change_ = next_calculation_; }
  void free(Proxy& proxy) noexcept {
    proxy = Proxy();
    last_id_change_ = next_calculation_;
  }
  void end_calculation() noexcept { ++next_calculation_; }

  /// Whether both proxies have existed since before the last calculation.
  [[nodiscard]] bool is_known(const Pair& pair) const { return is_known(pair.a) && is_known(pair.b); }
  /// Whether all ids stand for the same proxies as at the last calculation.
  [[nodiscard]] bool are_all_known() const noexcept { return last_id_change_ != next_calculation_; }
  [[nodiscard]] bool is_changed(const Pair& pair) const {
    return (*this)[pair.a].changed == next_calculation_ || (*this)[pair.b].changed == next_calculation_;
  }
  [[nodiscard]] bool is_any_changed() const noexcept { return last_change_ == next_calculation_; }

 private:
  static constexpr std::size_t chunk_size = 256;
  using Chunk = std::array<Proxy, chunk_size>;

  [[nodiscard]] bool is_known(std::uint32_t id) const {
    return (*this)[id].is_live() && (*this)[id].created != next_calculation_;
  }

  std::vector<std::unique_ptr<Chunk>> chunks_;
  std::uint32_t next_calculation_ = 1;  // its number
  std::uint32_t last_change_ = 0;       // the calculation before which a proxy was last changed
  std::uint32_t last_id_change_ = 0;    // the same for created or destroyed
};

}  // namespace broadcl
