#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/non_copyable.hpp"
#include "base/threads.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

/// Finds all pairs of boxes that overlap and may pair, by the definition, in canonical order.
/// @throws std::bad_alloc
void test_each_pair(const Input& input, std::vector<Pair>& pairs);

/// The part of an algorithm that finds pairs on the host, in canonical order, whatever the exclusions.
class HostFinder : NonCopyable {
 public:
  virtual ~HostFinder() = default;

  /// Finds all pairs of boxes that overlap and may pair.
  /// @throws std::bad_alloc; Error, as refuse_too_many() does.
  virtual void find(const Input& input, std::vector<Pair>& pairs) = 0;

  /// Finds those pairs of the last call of find() or find_changed() in which one of these slots took part, if
  /// that takes less time than to look at all pairs.
  /// @param filters As of that call.
  /// @returns Whether it did so.
  /// @throws std::bad_alloc
  virtual bool find_known(std::span<const Filter> /*filters*/, std::span<const std::uint32_t> /*changed*/,
                          std::vector<Pair>& /*pairs*/) {
    return false;
  }

  /// Finds those pairs in which a slot that changed takes part, if that takes less time than to find all. No
  /// other slot changed since the last call of find() or this function, which succeeded.
  /// @returns Whether it did so. (If there are too many pairs to store before they are counted, it does not.)
  /// @throws std::bad_alloc
  virtual bool find_changed(const Input& /*input*/, std::vector<Pair>& /*pairs*/) { return false; }

  /// The tree that find() and find_changed() read boxes into; null if there is none.
  [[nodiscard]] virtual BoxTree* tree() noexcept { return nullptr; }

  /// Frees all memory; the next search is then find().
  virtual void clear() noexcept {}
};

/// Makes an algorithm of the host. It needs no OpenCL and has no profile.
/// @param threads At most; 0 for one per processor.
[[nodiscard]] AlgorithmPointer make_host_engine(std::unique_ptr<HostFinder> finder, const Threads& threads);

}  // namespace broadcl
