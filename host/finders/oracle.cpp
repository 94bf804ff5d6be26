#include "base/distance.hpp"
#include "base/floating_point.hpp"
#include "base/packed_box.hpp"
#include "base/pair_lists.hpp"
#include "engines/host_engine.hpp"

namespace broadcl {
namespace {

/// Tests every pair by the definition.
template <class Function>
[[gnu::noinline]] void for_each_pair(const Input& input, const Function& function) {
  const std::span<const Aabb> boxes = input.boxes;
  const std::span<const Filter> filters = input.rules.filters;
  const std::span<const float> reaches = input.rules.reaches;
  for (std::uint32_t b = 0; b < boxes.size(); ++b) {
    const Aabb box = boxes[b];
    for (std::uint32_t a = 0; a < b; ++a) {
      const bool are_near = reaches.empty() ? packed_overlaps(boxes[a], box)
                                            : is_within(boxes[a], box, reaches[a] + reaches[b]);
      if (are_near && (filters.empty() || may_pair(filters[a], filters[b]))) function(Pair{a, b});
    }
  }
}

/// The reference that everything else is compared with.
class Oracle final : public HostFinder {
 public:
  void find(const Input& input, std::vector<Pair>& pairs) override {
    const DefaultFloatingPoint as_everywhere;
    constexpr std::size_t never_too_many = 65'536;  // boxes
    if (input.boxes.size() > never_too_many) {
      std::size_t count = 0;
      for_each_pair(input, [&](const Pair& /*pair*/) { ++count; });
      refuse_too_many(count);
    }
    test_each_pair(input, pairs);
  }
};

}  // namespace

void test_each_pair(const Input& input, std::vector<Pair>& pairs) {
  pairs.clear();
  for_each_pair(input, [&](const Pair& pair) { pairs.push_back(pair); });
}

AlgorithmPointer make_oracle(const Config& /*config*/) {
  return make_host_engine(std::make_unique<Oracle>(), 1);
}

}  // namespace broadcl
