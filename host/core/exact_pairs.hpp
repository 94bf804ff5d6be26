#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <broadcl/aabb.hpp>
#include <broadcl/pair.hpp>

#include "engines/algorithm.hpp"
#include "engines/change_lists.hpp"

namespace broadcl {

/// Turns the pairs and changes of a core in single precision into those in double precision. Among the pairs
/// that touch in single precision, it remembers those that are apart in double precision.
///
/// An update consists of begin(), that of the core, and commit(). If it fails before commit(), the pairs of
/// the last update are still known.
class ExactPairs final : public PairListener {
 public:
  /// @param threads That compare pairs, at most; 0 for one per processor.
  explicit ExactPairs(std::size_t threads) : threads_(threads) {}

  /// @param boxes Of the update, by id. May be written until the core lists the pairs.
  void begin(std::span<const Aabb64> boxes) noexcept { next_ = {.boxes = boxes}; }
  void list_touching(std::vector<Pair> pairs) override;
  void expect_changes(std::size_t added, std::size_t removed) override;
  /// To be called if a box has changed, perhaps by less than single precision can tell: if the core had
  /// nothing to do, compares the pairs that touched in the last update.
  /// @throws std::bad_alloc
  void compare_again();
  /// @param found The changes of the core.
  Delta commit(const Delta& found) noexcept;

  /// How many pairs touch in single precision.
  [[nodiscard]] std::size_t touching() const noexcept { return touching_.size(); }
  /// The pairs of the core that overlap in double precision.
  /// @throws std::bad_alloc
  [[nodiscard]] std::vector<Pair> overlapping(std::vector<Pair> pairs) const;

  /// Frees what the next update does not need.
  void shrink() noexcept;

 private:
  /// A pair that is inserted into a list, or left out of it.
  struct Edit {
    std::size_t from;  // the index in the list of the pair, or of the next one
    std::size_t to;    // the index in the edited list
    Pair pair;
    bool is_inserted;
    [[nodiscard]] std::size_t next_from() const noexcept { return is_inserted ? from : from + 1; }
    [[nodiscard]] std::size_t next_to() const noexcept { return is_inserted ? to + 1 : to; }
  };

  static void find_edits(std::span<const Pair> changes, std::span<const Pair> except,
                         std::span<const Pair> turned, std::span<const Pair> opposite,
                         std::vector<Edit>& edits) noexcept;
  void apply(std::span<const Pair> changes, std::span<const Edit> edits,
             std::vector<Pair>& out) const noexcept;

  /// What becomes of the members of the same name.
  struct Next {
    std::span<const Aabb64> boxes{};
    bool is_listed = false;
    std::vector<Pair> touching{}, apart{};
    // The lists to return, with memory for all changes; null if those of the core will do.
    std::vector<Pair>*added = nullptr, *removed = nullptr;
    std::shared_ptr<const void> owner{};
    std::vector<Edit> added_edits{}, removed_edits{};  // to the lists of the core, with memory for all
  };

  std::size_t threads_;
  std::vector<Pair> touching_;  // in single precision, in any order
  std::vector<Pair> apart_;     // those of them that do not overlap in double precision, in canonical order
  ChangeLists lists_;
  Next next_;
};

}  // namespace broadcl
