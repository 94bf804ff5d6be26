#include "algorithms/host_engine.hpp"
#include "packed_box.hpp"

namespace broadcl {
namespace {

/// Tests every pair by the definition: the reference that everything else is compared with.
class Oracle final : public HostFinder {
 public:
  void find(const HostObjects& objects, std::vector<Pair>& pairs) override {
    const std::span<const Aabb> boxes = objects.boxes;
    const std::span<const Filter> filters = objects.filters;
    pairs.clear();
    for (std::uint32_t b = 0; b < boxes.size(); ++b) {
      const Aabb box = boxes[b];
      for (std::uint32_t a = 0; a < b; ++a) {
        if (packed_overlaps(boxes[a], box) && (filters.empty() || may_pair(filters[a], filters[b]))) {
          pairs.push_back({a, b});
        }
      }
    }
  }
};

}  // namespace

std::unique_ptr<Algorithm> make_oracle(const Config& /*config*/) {
  return make_host_engine(std::make_unique<Oracle>());
}

}  // namespace broadcl
