#include <broadcl/broad_phase.hpp>

#include <algorithm>
#include <functional>
#include <queue>
#include <string>
#include <utility>

#include "algorithms/algorithm.hpp"

namespace broadcl {
namespace {

Aabb pack(const Aabb& box) {
  return is_empty(box) ? empty_aabb() : box;
}

}  // namespace

class BroadPhase::Impl {
 public:
  explicit Impl(const Config& config)
      : row_(find_algorithm(config.algorithm)), algorithm_(row_.make(config)) {}

  std::uint32_t add(const Aabb& box) {
    refuse_nan(box);
    const auto id = free_.empty() ? static_cast<std::uint32_t>(states_.size()) : free_.top();
    if (id == states_.size()) {
      algorithm_->reserve(states_.size() + 1);
      states_.push_back(State::free);
    } else {
      free_.pop();
    }
    set(id, State::live);
    algorithm_->boxes()[id] = pack(box);
    ++size_;
    return id;
  }

  void move(std::uint32_t id, const Aabb& box) {
    refuse_unknown(id);
    refuse_nan(box);
    algorithm_->boxes()[id] = pack(box);
  }

  void remove(std::uint32_t id) {
    refuse_unknown(id);
    free_.push(id);
    set(id, State::free);
    algorithm_->boxes()[id] = empty_aabb();
    --size_;
  }

  Delta update() {
    std::sort(renewed_.begin(), renewed_.end());
    const auto last = std::find(states_.rbegin(), states_.rend(), State::live);
    const Delta delta = algorithm_->update(static_cast<std::size_t>(states_.rend() - last), renewed_);
    for (const std::uint32_t id : renewed_) is_renewed_[id] = false;
    renewed_.clear();
    return delta;
  }

  [[nodiscard]] const AlgorithmRow& row() const noexcept { return row_; }
  [[nodiscard]] const Algorithm& algorithm() const noexcept { return *algorithm_; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  enum class State : std::uint8_t { free, live };

  void set(std::uint32_t id, State state) {
    states_[id] = state;
    is_renewed_.resize(states_.size());
    if (!is_renewed_[id]) renewed_.push_back(id);
    is_renewed_[id] = true;
  }

  void refuse_unknown(std::uint32_t id) const {
    if (id >= states_.size() || states_[id] == State::free) {
      throw Error("no object has the id " + std::to_string(id) + "; use the ids that add() returned");
    }
  }

  static void refuse_nan(const Aabb& box) {
    if (has_nan(box))
      throw Error("a box has a NaN bound; give an empty box (lower > upper) for an object without one");
  }

  const AlgorithmRow& row_;
  std::unique_ptr<Algorithm> algorithm_;
  std::vector<State> states_;  // a slot each
  std::priority_queue<std::uint32_t, std::vector<std::uint32_t>, std::greater<>> free_;
  std::vector<std::uint32_t> renewed_;  // slots that changed hands since the last update
  std::vector<bool> is_renewed_;
  std::size_t size_ = 0;
};

BroadPhase::BroadPhase() : BroadPhase(Config()) {}
BroadPhase::BroadPhase(const Config& config) : impl_(std::make_unique<Impl>(config)) {}
BroadPhase::~BroadPhase() = default;
BroadPhase::BroadPhase(BroadPhase&&) noexcept = default;
BroadPhase& BroadPhase::operator=(BroadPhase&&) noexcept = default;

std::uint32_t BroadPhase::add(const Aabb& box) {
  return impl_->add(box);
}

void BroadPhase::move(std::uint32_t id, const Aabb& box) {
  impl_->move(id, box);
}

void BroadPhase::remove(std::uint32_t id) {
  impl_->remove(id);
}

Delta BroadPhase::update() {
  return impl_->update();
}

std::vector<Pair> BroadPhase::pairs() const {
  return impl_->algorithm().pairs();
}

std::size_t BroadPhase::size() const noexcept {
  return impl_->size();
}

const Device* BroadPhase::device() const noexcept {
  return impl_->algorithm().device();
}

const AlgorithmInfo& BroadPhase::algorithm() const noexcept {
  return impl_->row().info;
}

std::span<const Stage> BroadPhase::profile() const noexcept {
  return impl_->algorithm().profile();
}

std::vector<Pair> overlapping_pairs(std::span<const Aabb> boxes, const BroadPhase::Config& config) {
  const auto bad = std::find_if(boxes.begin(), boxes.end(), has_nan);
  if (bad != boxes.end()) {
    throw Error("box " + std::to_string(bad - boxes.begin()) +
                " has a NaN bound; give an empty box (lower > upper) for an object without one");
  }
  const auto algorithm = find_algorithm(config.algorithm).make(config);
  algorithm->reserve(boxes.size());
  std::transform(boxes.begin(), boxes.end(), algorithm->boxes().begin(), pack);
  const Delta delta = algorithm->update(boxes.size(), {});
  return {delta.added.begin(), delta.added.end()};
}

}  // namespace broadcl
