#pragma once

#include <broadcl/cxx20.hpp>
#ifdef BROADCL_CXX20

#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <broadcl/export.h>
#include <broadcl/aabb.hpp>

namespace broadcl {

template <class Box>
class BasicBroadPhase;
namespace detail {
template <class Box>
struct Saved;
}

/// What BasicBroadPhase::save() returns: ids, boxes, filters, reaches and exclusions of all objects as of
/// that moment. Copies share it. It takes 25 bytes for each id up to the highest (49 in double precision), 16
/// more with filters and 4 (8) with reaches. Any number of threads may use it at the same time.
template <class Box>
class BROADCL_API BasicState {
 public:
  /// The state to be stored or sent, little-endian. Only the same version of the library reads it.
  [[nodiscard]] std::vector<std::byte> bytes() const;
  /// @throws Error for bytes of another version or another type of boxes, and for those that no state has.
  [[nodiscard]] static BasicState from_bytes(std::span<const std::byte> bytes);

 private:
  friend class BasicBroadPhase<Box>;
  explicit BasicState(std::shared_ptr<const detail::Saved<Box>> saved) noexcept : saved_(std::move(saved)) {}

  std::shared_ptr<const detail::Saved<Box>> saved_;
};

using State = BasicState<Aabb>;      ///< Of a BroadPhase.
using State64 = BasicState<Aabb64>;  ///< Of a BroadPhase64.

extern template class BROADCL_API BasicState<Aabb>;
extern template class BROADCL_API BasicState<Aabb64>;

}  // namespace broadcl

#endif
