#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/filter.hpp>

#include "base/non_copyable.hpp"
#include "base/threads.hpp"
#include "engines/ranked_search.hpp"

namespace broadcl {

struct Input;

/// A box to search for; packed.
struct QueryBox {
  Aabb box;
  float reach = 0;
  /// Only objects that may be in the same world have to be found.
  std::uint32_t world = Filter::all_worlds;
};

/// A query, by its index, and the slot of a box that it found.
struct Hit {
  std::uint32_t query;
  std::uint32_t slot;
};

/// The hits of a tile of queries, in any order.
class HitList : NonCopyable {
 public:
  /// @returns Where the next hits are to be stored.
  /// @throws std::bad_alloc
  [[nodiscard]] Hit* reserve(std::size_t more) {
    if (static_cast<std::size_t>(end_ - next_) < more) grow(more);
    return next_;
  }
  void set_end(Hit* end) noexcept { next_ = end; }
  void clear() noexcept { next_ = begin_; }
  [[nodiscard]] std::span<Hit> get() noexcept { return {begin_, next_}; }

 private:
  [[gnu::noinline]] void grow(std::size_t more) {
    const std::size_t size = get().size();
    std::vector<Hit> larger(2 * (size + more));
    std::ranges::copy(get(), larger.begin());
    many_.swap(larger);
    begin_ = many_.data();
    next_ = begin_ + size;
    end_ = begin_ + many_.size();
  }

  std::array<Hit, 2048> few_;  // not initialised
  std::vector<Hit> many_;      // instead, if there were more
  Hit* begin_ = few_.data();
  Hit* next_ = begin_;
  Hit* end_ = begin_ + few_.size();
};

/// The boxes of objects in a tree of the host, for updates and queries.
class BoxTree {
 public:
  virtual ~BoxTree() = default;

  /// Queries that are searched for at once, at most. They should be near each other.
  static constexpr std::size_t most_queries = 32;

  /// Puts boxes that changed since the last call into the tree; all of them if it is not ready.
  /// @throws std::bad_alloc; then it is not ready.
  virtual void read(const Input& input) = 0;
  /// Whether all boxes are in it, as they were when they were last read.
  [[nodiscard]] virtual bool is_ready() const noexcept = 0;
  /// Appends the slots that an object with the box and the reach of a query would pair with, by their boxes.
  /// Several threads may call this at the same time, under DefaultFloatingPoint. Only if it is ready.
  /// @param queries At most most_queries.
  /// @throws std::bad_alloc
  virtual void find(std::span<const QueryBox> queries, HitList& hits) const = 0;
  /// Passes boxes that a search wants to it. Likewise, but allocates nothing, and leaves the floating-point
  /// environment to the caller.
  virtual void find(RankedSearch<Aabb>& search) const = 0;
  virtual void find(RankedSearch<Aabb64>& search) const = 0;
};

/// @param threads At most; 0 for one per processor.
[[nodiscard]] std::unique_ptr<BoxTree> make_box_tree(const Threads& threads);

/// The indices of those boxes that are not empty in an order in which neighbours are together, most_queries
/// at a time. If there are no more, no_query.
/// @param filters One per box if they are in different worlds.
/// @throws std::bad_alloc
[[nodiscard]] std::vector<std::uint32_t> order_in_space(std::span<const Aabb> boxes,
                                                        std::span<const Filter> filters,
                                                        const Threads& threads);
inline constexpr std::uint32_t no_query = 0xffffffff;

}  // namespace broadcl
