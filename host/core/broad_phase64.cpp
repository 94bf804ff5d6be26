#include <broadcl/broad_phase64.hpp>

#include "core/core64.hpp"
#include "engines/algorithm.hpp"

namespace broadcl {

class BroadPhase64::Impl final : public Core64 {
 public:
  explicit Impl(const Config& config)
      : Core64(make_algorithm(config), config.threads), info_(find_algorithm(config.algorithm).info) {}

  [[nodiscard]] const AlgorithmInfo& info() const noexcept { return info_; }

 private:
  const AlgorithmInfo& info_;
};

BroadPhase64::BroadPhase64() : BroadPhase64(Config()) {}
BroadPhase64::BroadPhase64(const Config& config) : impl_(std::make_unique<Impl>(config)) {}
BroadPhase64::~BroadPhase64() = default;
BroadPhase64::BroadPhase64(BroadPhase64&&) noexcept = default;
BroadPhase64& BroadPhase64::operator=(BroadPhase64&&) noexcept = default;

std::uint32_t BroadPhase64::add(const Aabb64& box, const Filter& filter) {
  return impl_->add(box, filter);
}

std::vector<std::uint32_t> BroadPhase64::add(const BoxView& boxes, std::span<const Filter> filters) {
  return impl_->add(boxes, filters);
}

std::vector<std::uint32_t> BroadPhase64::add(const BoxView& boxes, const Filter& filter) {
  return impl_->add(boxes, {&filter, 1});
}

void BroadPhase64::move(std::uint32_t id, const Aabb64& box) {
  impl_->move(id, box);
}

void BroadPhase64::move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
  impl_->move(ids, boxes);
}

void BroadPhase64::set_filter(std::uint32_t id, const Filter& filter) {
  impl_->set_filter(id, filter);
}

void BroadPhase64::set_exclusions(std::span<const Pair> pairs) {
  impl_->set_exclusions(pairs);
}

void BroadPhase64::remove(std::uint32_t id) {
  impl_->remove(id);
}

void BroadPhase64::remove(std::span<const std::uint32_t> ids) {
  impl_->remove(ids);
}

bool BroadPhase64::contains(std::uint32_t id) const noexcept {
  return impl_->contains(id);
}

Aabb64 BroadPhase64::box(std::uint32_t id) const {
  return impl_->box(id);
}

Filter BroadPhase64::filter(std::uint32_t id) const {
  return impl_->filter(id);
}

MappedBoxes64 BroadPhase64::map(std::size_t n) {
  const std::span<Aabb64> boxes = impl_->map(n);
  return {boxes, impl_->boxes_owner()};
}

Delta BroadPhase64::update() {
  return impl_->finish();
}

Delta BroadPhase64::update(const BoxView& boxes) {
  return impl_->update(boxes);
}

void BroadPhase64::begin() {
  impl_->begin();
  impl_->flush();
}

void BroadPhase64::begin(const BoxView& boxes) {
  impl_->begin(boxes);
}

Delta BroadPhase64::finish() {
  return impl_->finish();
}

void BroadPhase64::shrink() {
  impl_->shrink();
}

std::vector<Pair> BroadPhase64::pairs() const {
  return impl_->pairs();
}

std::size_t BroadPhase64::size() const noexcept {
  return impl_->size();
}

const Device* BroadPhase64::device() const noexcept {
  return impl_->algorithm().device();
}

MemoryUse BroadPhase64::memory() const noexcept {
  return impl_->algorithm().memory();
}

const AlgorithmInfo& BroadPhase64::algorithm() const noexcept {
  return impl_->info();
}

std::span<const Stage> BroadPhase64::profile() const noexcept {
  return impl_->profile();
}

}  // namespace broadcl
