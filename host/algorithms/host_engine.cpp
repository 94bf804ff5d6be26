#include "algorithms/host_engine.hpp"

#include <algorithm>
#include <utility>

#include "packed_box.hpp"
#include "pair_lists.hpp"

namespace broadcl {
namespace {

class HostEngine final : public Algorithm {
 public:
  explicit HostEngine(FindOnHost find) : find_(std::move(find)) {}

  void reserve(std::size_t slots, bool /*filters*/) override {
    if (slots > boxes_.size()) boxes_.resize(std::max(slots, boxes_.size() * 3 / 2), packed_empty());
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return boxes_; }

  void begin(const Changes& changes) override {
    changes_ = changes;
    filters_.assign(changes.filters.begin(), changes.filters.end());
  }

  Delta finish() override {
    std::vector<Pair> now = find_(std::span(boxes_).first(changes_.slots), filters_);
    const auto is_recycled = [&](std::uint32_t slot) {
      return std::binary_search(changes_.recycled.begin(), changes_.recycled.end(), slot);
    };
    std::vector<Pair> kept = intersection(pairs_, now);
    std::erase_if(kept, [&](const Pair& pair) { return is_recycled(pair.a) || is_recycled(pair.b); });
    added_ = difference(now, kept);
    removed_ = difference(pairs_, kept);
    pairs_ = std::move(now);
    return {added_, removed_};
  }

  [[nodiscard]] std::vector<Pair> pairs() override { return pairs_; }
  [[nodiscard]] const Device* device() const noexcept override { return nullptr; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return {}; }

 private:
  FindOnHost find_;
  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
  Changes changes_;
  std::vector<Pair> pairs_, added_, removed_;
};

}  // namespace

std::unique_ptr<Algorithm> make_host_engine(FindOnHost find) {
  return std::make_unique<HostEngine>(std::move(find));
}

}  // namespace broadcl
