#include "algorithms/host_engine.hpp"
#include "packed_box.hpp"
#include "pair_lists.hpp"

namespace broadcl {
namespace {

/// Tests every pair by the definition: the reference that everything else is compared with.
class Oracle final : public HostFinder {
 public:
  void find(const HostObjects& objects, std::vector<Pair>& pairs) override {
    const std::span<const Aabb> boxes = objects.boxes;
    const std::span<const Filter> filters = objects.filters;
    const auto for_each_pair = [&](const auto& function) {
      for (std::uint32_t b = 0; b < boxes.size(); ++b) {
        const Aabb box = boxes[b];
        for (std::uint32_t a = 0; a < b; ++a) {
          if (packed_overlaps(boxes[a], box) && (filters.empty() || may_pair(filters[a], filters[b]))) {
            function(Pair{a, b});
          }
        }
      }
    };
    constexpr std::size_t never_too_many = 65'536;  // boxes
    if (boxes.size() > never_too_many) {
      std::size_t count = 0;
      for_each_pair([&](const Pair& /*pair*/) { ++count; });
      refuse_too_many(count);
    }
    pairs.clear();
    for_each_pair([&](const Pair& pair) { pairs.push_back(pair); });
  }
};

}  // namespace

AlgorithmPointer make_oracle(const Config& /*config*/) {
  return make_host_engine(std::make_unique<Oracle>());
}

}  // namespace broadcl
