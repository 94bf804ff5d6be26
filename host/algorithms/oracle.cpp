#include <algorithm>
#include <iterator>

#include "algorithms/algorithm.hpp"

namespace broadcl {
namespace {

/// Every pair tested by the definition, on the host: the reference that everything else is compared with. Its
/// own profile is empty.
class Oracle final : public Algorithm {
 public:
  void reserve(std::size_t boxes) override {
    if (boxes > boxes_.size()) boxes_.resize(boxes, empty_aabb());
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return boxes_; }

  void begin(const Changes& changes) override {
    changes_ = changes;
    filters_.assign(changes.filters.begin(), changes.filters.end());
  }

  Delta finish() override {
    std::vector<Pair> now = find_pairs(changes_.slots);
    const auto is_renewed = [&](std::uint32_t slot) {
      return std::binary_search(changes_.renewed.begin(), changes_.renewed.end(), slot);
    };
    std::vector<Pair> kept;
    std::copy_if(pairs_.begin(), pairs_.end(), std::back_inserter(kept),
                 [&](const Pair& p) { return !is_renewed(p.a) && !is_renewed(p.b); });
    std::erase_if(kept, [&](const Pair& p) { return !std::binary_search(now.begin(), now.end(), p); });
    added_.clear();
    removed_.clear();
    std::set_difference(now.begin(), now.end(), kept.begin(), kept.end(), std::back_inserter(added_));
    std::set_difference(pairs_.begin(), pairs_.end(), kept.begin(), kept.end(), std::back_inserter(removed_));
    pairs_ = std::move(now);
    return {added_, removed_};
  }

  [[nodiscard]] std::vector<Pair> pairs() const override { return pairs_; }
  [[nodiscard]] const Device* device() const noexcept override { return nullptr; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return {}; }

 private:
  [[nodiscard]] std::vector<Pair> find_pairs(std::size_t n) const {
    std::vector<Pair> found;
    for (std::uint32_t b = 0; b < n; ++b) {
      const Aabb box = boxes_[b];
      for (std::uint32_t a = 0; a < b; ++a) {
        if (overlaps(boxes_[a], box) && (filters_.empty() || may_pair(filters_[a], filters_[b]))) {
          found.push_back({a, b});
        }
      }
    }
    return found;
  }

  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
  Changes changes_;
  std::vector<Pair> pairs_, added_, removed_;
};

}  // namespace

std::unique_ptr<Algorithm> make_oracle(const BroadPhase::Config& /*config*/) {
  return std::make_unique<Oracle>();
}

}  // namespace broadcl
