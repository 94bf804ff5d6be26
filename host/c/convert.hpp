#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <broadcl/broadcl.h>
#include <broadcl/aabb.hpp>
#include <broadcl/algorithms.hpp>
#include <broadcl/box_view.hpp>
#include <broadcl/config.hpp>
#include <broadcl/device.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/memory.hpp>
#include <broadcl/pair.hpp>
#include <broadcl/profile.hpp>
#include <broadcl/query.hpp>

/// The values of the C interface and those of C++.
namespace broadcl::c {

[[nodiscard]] inline broadcl_aabb to_c(const Aabb& box) noexcept {
  return {{box.lower[0], box.lower[1], box.lower[2]}, {box.upper[0], box.upper[1], box.upper[2]}};
}

[[nodiscard]] inline broadcl_filter to_c(const Filter& filter) noexcept {
  return {.group = filter.group, .mask = filter.mask, .body = filter.body, .world = filter.world};
}

[[nodiscard]] inline Filter to_filter(const broadcl_filter& filter) noexcept {
  return {.group = filter.group, .mask = filter.mask, .body = filter.body, .world = filter.world};
}

[[nodiscard]] inline broadcl_aabb64 to_c(const Aabb64& box) noexcept {
  return {{box.lower[0], box.lower[1], box.lower[2]}, {box.upper[0], box.upper[1], box.upper[2]}};
}

static_assert(sizeof(broadcl_pair) == sizeof(Pair) && sizeof(broadcl_aabb) == sizeof(Aabb) &&
              sizeof(broadcl_aabb64) == sizeof(Aabb64) && sizeof(broadcl_filter) == sizeof(Filter));

[[nodiscard]] inline broadcl_pairs to_c(std::span<const Pair> pairs) noexcept {
  return {reinterpret_cast<const broadcl_pair*>(pairs.data()), pairs.size()};
}

[[nodiscard]] inline broadcl_delta to_c(const Delta& delta) noexcept {
  return {to_c(delta.added), to_c(delta.removed)};
}

[[nodiscard]] inline broadcl_memory_use to_c(const MemoryUse& use) noexcept {
  return {sizeof(broadcl_memory_use), use.device, use.device_peak, use.pinned};
}

/// Pairs of the caller.
/// @throws Error if the pointer is null and the count is not 0.
[[nodiscard]] std::span<const Pair> to_pairs(const broadcl_pair* pairs, std::size_t count, const char* name);

/// Filters of the caller, likewise.
[[nodiscard]] std::span<const Filter> to_filters(const broadcl_filter* filters, std::size_t count,
                                                 const char* name);

/// @throws Error for arguments that BoxView does not accept.
[[nodiscard]] BoxView to_view(const broadcl_boxes* boxes, const char* name);

/// @throws Error
[[nodiscard]] Config to_config(const broadcl_config* config);

/// @throws Error
[[nodiscard]] QueryOptions to_options(const broadcl_query_options* options);

/// Whether the boxes of a broadcl_broad_phase are float64.
/// @throws Error for an unknown type.
[[nodiscard]] bool is_float64(const broadcl_config* config);

/// Null if the handler is null.
[[nodiscard]] CompileHandler to_handler(broadcl_compile_handler handler, void* data);

/// A device and the strings about it.
class DeviceFacts {
 public:
  explicit DeviceFacts(Device device);
  /// The strings belong to this object.
  [[nodiscard]] broadcl_device_info info() const noexcept;

 private:
  Device device_;
  std::string id_;
  std::string label_;
};

/// The stages of an update.
[[nodiscard]] std::vector<broadcl_stage> to_c(std::span<const Stage> stages);

/// The row of an algorithm of the table.
[[nodiscard]] const broadcl_algorithm& row_of(const AlgorithmInfo& algorithm);

/// The table.
[[nodiscard]] std::span<const broadcl_algorithm> rows();

}  // namespace broadcl::c
