#include "finders/pair_sort.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <utility>

#include "base/pair_lists.hpp"
#include "base/parallel.hpp"

namespace broadcl {
namespace {

constexpr unsigned most_partition_bits = 8;
/// Fewer pairs are sorted by comparison instead, and so are more than 32-bit positions count.
constexpr std::size_t most_compared = 32;
constexpr std::size_t most_in_partition = 0xffffffff;

/// A thread takes partitions with about so many pairs at a time.
constexpr std::size_t pairs_at_once = 1024;

/// A pass of a radix sort, stable.
template <class Digit>
void sort_by(std::span<const Pair> from, std::span<Pair> to, unsigned digits, const Digit& digit) {
  constexpr std::size_t most_digits = 1U << 11U;
  std::array<std::uint32_t, most_digits> next;
  std::fill_n(next.begin(), digits, 0U);
  for (const Pair& pair : from) ++next[digit(pair)];
  std::uint32_t sum = 0;
  for (unsigned k = 0; k < digits; ++k) sum += std::exchange(next[k], sum);
  for (const Pair& pair : from) to[next[digit(pair)]++] = pair;
}

/// Sorts a partition.
/// @param bits_of_a, bits_of_b How many of the lowest bits may differ between pairs.
void sort_partition(std::span<Pair> pairs, unsigned bits_of_a, unsigned bits_of_b,
                    std::vector<Pair>& scratch) {
  if (pairs.size() <= most_compared || pairs.size() > most_in_partition) {
    std::ranges::sort(pairs);
    return;
  }
  if (scratch.size() < pairs.size()) scratch.resize(pairs.size());
  const unsigned digit_bits = pairs.size() < 8192 ? 8 : 11;
  std::span<Pair> from = pairs;
  std::span<Pair> to = std::span(scratch).first(pairs.size());
  const auto pass = [&](unsigned shift, unsigned bits, std::uint32_t Pair::*member) {
    const std::uint32_t mask = (1U << bits) - 1;
    sort_by(from, to, 1U << bits, [=](const Pair& pair) { return pair.*member >> shift & mask; });
    std::swap(from, to);
  };
  for (const auto& [bits, member] : {std::pair(bits_of_a, &Pair::a), {bits_of_b, &Pair::b}}) {
    const unsigned passes = (bits + digit_bits - 1) / digit_bits;
    for (unsigned k = 0; k < passes; ++k) {
      const unsigned first = bits * k / passes;
      pass(first, bits * (k + 1) / passes - first, member);
    }
  }
  if (from.data() != pairs.data()) std::ranges::copy(from, pairs.begin());
}

}  // namespace

void PairSort::operator()(std::span<const std::span<const Pair>> lists, std::size_t slots,
                          const Threads& threads, std::vector<Pair>& sorted) {
  std::size_t total = 0;
  for (const std::span<const Pair> list : lists) total += list.size();
  resize_for_writing(sorted, total);
  const auto bits = static_cast<unsigned>(std::bit_width(slots));
  const auto partition_bits =
      std::min({bits, most_partition_bits, static_cast<unsigned>(std::bit_width(total / most_compared))});
  const unsigned low_bits = bits - partition_bits;
  const std::size_t partitions = std::size_t{1} << partition_bits;
  const auto partition_of = [=](const Pair& pair) { return std::uint64_t{pair.b} >> low_bits; };
  positions_.resize(lists.size());
  scratch_.resize(std::max(scratch_.size(), threads.most));
  parallel_for(lists.size(), threads, [&](std::size_t k, std::size_t /*thread*/) {
    positions_[k].assign(partitions, 0);
    for (const Pair& pair : lists[k]) ++positions_[k][partition_of(pair)];
  });
  std::array<std::size_t, (std::size_t{1} << most_partition_bits) + 1> starts;
  std::size_t sum = 0;
  for (std::size_t partition = 0; partition < partitions; ++partition) {
    starts[partition] = sum;
    for (std::vector<std::size_t>& positions : positions_) sum += std::exchange(positions[partition], sum);
  }
  starts[partitions] = total;
  parallel_for(lists.size(), threads, [&](std::size_t k, std::size_t /*thread*/) {
    for (const Pair& pair : lists[k]) sorted[positions_[k][partition_of(pair)]++] = pair;
  });
  const unsigned part_bits =
      std::min(partition_bits, static_cast<unsigned>(std::bit_width(total / pairs_at_once)));
  const std::size_t at_once = partitions >> part_bits;
  parallel_for(std::size_t{1} << part_bits, threads, [&](std::size_t part, std::size_t thread) {
    const std::size_t end = (part + 1) * at_once;
    for (std::size_t k = part * at_once; k < end; ++k) {
      const std::span<Pair> partition = std::span(sorted).subspan(starts[k], starts[k + 1] - starts[k]);
      sort_partition(partition, bits, low_bits, scratch_[thread]);
    }
  });
}

}  // namespace broadcl
