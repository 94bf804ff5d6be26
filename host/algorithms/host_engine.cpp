#include "algorithms/host_engine.hpp"

#include <algorithm>
#include <utility>

#include "packed_box.hpp"

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
    find_(std::span(boxes_).first(changes_.slots), filters_, now_);
    added_.clear();
    removed_.clear();
    auto last = pairs_.cbegin();
    for (const Pair& pair : now_) {
      for (; last != pairs_.cend() && *last < pair; ++last) removed_.push_back(*last);
      const bool was_pair = last != pairs_.cend() && *last == pair;
      const bool is_new = !was_pair || is_recycled(pair.a) || is_recycled(pair.b);
      if (is_new) added_.push_back(pair);
      if (is_new && was_pair) removed_.push_back(pair);
      if (was_pair) ++last;
    }
    removed_.insert(removed_.end(), last, pairs_.cend());
    std::swap(pairs_, now_);
    return {added_, removed_};
  }

  [[nodiscard]] std::vector<Pair> find_all(const Changes& changes) override {
    std::vector<Pair> pairs;
    find_(std::span(boxes_).first(changes.slots), changes.filters, pairs);
    return pairs;
  }

  [[nodiscard]] std::vector<Pair> pairs() override { return pairs_; }
  [[nodiscard]] const Device* device() const noexcept override { return nullptr; }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return {}; }

 private:
  [[nodiscard]] bool is_recycled(std::uint32_t slot) const {
    return std::ranges::binary_search(changes_.recycled, slot);
  }

  FindOnHost find_;
  std::vector<Aabb> boxes_;
  std::vector<Filter> filters_;
  Changes changes_;
  std::vector<Pair> pairs_, added_, removed_;  // as of the last update
  std::vector<Pair> now_;
};

}  // namespace

std::unique_ptr<Algorithm> make_host_engine(FindOnHost find) {
  return std::make_unique<HostEngine>(std::move(find));
}

}  // namespace broadcl
