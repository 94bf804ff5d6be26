#pragma once

#include <cstddef>

#include "engines/pair_delta.hpp"
#include "engines/search.hpp"
#include "opencl/api.hpp"

namespace broadcl {

/// Where a frame writes its changes on the device: to lists of an Order, or to buffers of a caller who does
/// not wait for it.
struct Report {  // NOLINT(bugprone-exception-escape): handles do not throw when moved
  cl::Buffer added{}, removed{};
  cl::Buffer counts{};                            ///< As kernels/order.h reports them, if not null.
  std::size_t capacity = 0;                       ///< Pairs that each list has memory for.
  cl::Buffer added_offsets{}, removed_offsets{};  ///< Where worlds begin, if changes are ordered by world.
};

/// How the changes of one frame are ordered: kernels/order.h.
struct OrderPlan {  // NOLINT(bugprone-exception-escape): as above
  /// The least number of changes to read with the counts, and the least capacity for them.
  static constexpr std::size_t least_changes = 512;

  std::size_t slots = 1;   ///< Greater than every slot of the pairs.
  std::size_t worlds = 0;  ///< By which changes are ordered, or 0.
  cl_uint second_set = 0;  ///< Its first slot, or 0.
  cl::Buffer filters{}, last_filters{};

  bool is_awaited = true;         ///< Whether the host waits for the frame.
  bool by_buckets = false;        ///< Otherwise all changes of a list are sorted in one launch.
  std::size_t capacity = 0;       ///< Changes that there is memory for.
  std::size_t list_capacity = 0;  ///< Those of one list.
  std::size_t expected = 0;       ///< Changes that are read together with the counts.
  std::size_t buckets = 0;        ///< Of one list.
  cl_uint bucket_bits = 0;        ///< A bucket has the pairs of 2^bucket_bits slots.
  Report report{};

  OrderPlan() = default;
  explicit OrderPlan(const Search& search);

  /// Sets the number of buckets: one per world, and one for pairs of no such world; or about as many as
  /// changes, so that there is little to clear and to add up.
  /// @param one_per_slot Because a bucket was too large before.
  void set_buckets(bool one_per_slot);

  /// Whether a frame with these counts was ordered by the kernels.
  [[nodiscard]] bool fits(const PairDelta::Counts& counts) const noexcept;
};

/// How much changed in earlier frames, and what to expect of the next one.
class ChangeHistory {
 public:
  /// Whether some list will probably have more changes than this. (Only if there were as many twice in a
  /// row: a first frame finds all pairs, the next one only what changed.)
  [[nodiscard]] bool expects_more_than(std::size_t changes) const noexcept;
  /// Sets how many changes to have memory for, and how many to read together with the counts.
  /// @param most_sorted Of a list, in one launch.
  /// @param most Changes that there may be memory for.
  void set_capacity(OrderPlan& plan, std::size_t most_sorted, std::size_t most) noexcept;

  [[nodiscard]] bool was_bucket_too_large() const noexcept { return was_bucket_too_large_; }
  void bucket_was_too_large() noexcept { was_bucket_too_large_ = true; }

  /// The frame succeeded.
  void commit(const PairDelta::Counts& counts) noexcept;

 private:
  std::size_t changes_ = 0;            // of the last frame
  std::size_t longest_ = 0;            // the longer of its lists
  std::size_t longest_before_ = 0;     // that of the frame before
  std::size_t wanted_ = 0;             // the number of changes to have memory for in the last frame
  std::size_t allocated_ = 0;          // changes that there was memory for in some frame
  bool was_bucket_too_large_ = false;  // in some frame
};

}  // namespace broadcl
