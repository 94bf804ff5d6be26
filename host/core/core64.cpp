#include "core/core64.hpp"

#include <string>

#include <broadcl/error.hpp>

#include "base/box_parts.hpp"
#include "base/packed_box.hpp"

namespace broadcl {
namespace {

/// So often it is asked whether another origin would be better.
constexpr std::size_t updates_per_choice = 16;

/// How many pairs touch, per object, before another origin might be worth it.
constexpr double touching_per_object = 0.25;

}  // namespace

void Core64::reserve(std::size_t objects) {
  if (objects <= boxes_->capacity()) return boxes_->resize(std::max(boxes_->size(), objects));
  auto larger = std::make_shared<Boxes>();  // for somebody may keep the memory of map()
  larger->reserve(std::max(objects, boxes_->size() + boxes_->size() / 2));
  larger->assign(boxes_->begin(), boxes_->end());
  larger->resize(objects);
  boxes_ = std::move(larger);
}

void Core64::reserve_late(std::size_t count) {
  if (is_begun_) late_.reserve(count, boxes_->size());
}

void Core64::store(std::uint32_t id, const Aabb64& box) noexcept {
  has_changed_ = true;
  must_convert_ = must_convert_ || (origin_.is_flat() && !is_flat_or_empty(box));
  if (is_begun_) {
    late_.set(id, box);
  } else {
    (*boxes_)[id] = box;
  }
}

std::vector<Aabb64> Core64::read(const BoxView& boxes) const {
  std::vector<Aabb64> exact(boxes.size());
  for_each_part(exact.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    boxes.read(begin, std::span(exact).subspan(begin, end - begin));
  });
  return exact;
}

std::vector<Aabb> Core64::convert(std::span<const Aabb64> boxes) const {
  std::vector<Aabb> converted(boxes.size());
  for_each_part(boxes.size(), threads_, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    origin_.convert(boxes.subspan(begin, end - begin), std::span(converted).subspan(begin, end - begin));
  });
  return converted;
}

std::uint32_t Core64::add(const Aabb64& box, const Filter& filter) {
  reserve(size() + 1);  // the lowest free id is at most their number
  reserve_late(1);
  const std::uint32_t id = core_.add(origin_.convert(box), filter);
  // Nothing below throws.
  store(id, box);
  return id;
}

std::vector<std::uint32_t> Core64::add(const BoxView& boxes, std::span<const Filter> filters) {
  Core::refuse_addition(boxes.size(), filters.size());
  const std::vector<Aabb64> exact = read(boxes);
  const std::vector<Aabb> converted = convert(exact);
  reserve(size() + exact.size());
  reserve_late(exact.size());
  std::vector<std::uint32_t> ids = core_.add(converted, filters);
  // Nothing below throws.
  for (std::size_t k = 0; k < ids.size(); ++k) store(ids[k], exact[k]);
  return ids;
}

void Core64::move(std::uint32_t id, const Aabb64& box) {
  reserve_late(1);
  core_.move(id, origin_.convert(box));
  // Nothing below throws.
  store(id, box);
}

void Core64::move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
  Core::refuse_moves(ids.size(), boxes.size());
  const std::vector<Aabb64> exact = read(boxes);
  const std::vector<Aabb> converted = convert(exact);
  reserve_late(ids.size());
  core_.move(ids, converted);
  // Nothing below throws.
  for (std::size_t k = 0; k < ids.size(); ++k) store(ids[k], exact[k]);
}

Aabb64 Core64::box(std::uint32_t id) const {
  (void)core_.box(id);  // if there is such an object
  const Aabb64* const late = late_.find(id);
  return late != nullptr ? *late : (*boxes_)[id];
}

std::span<Aabb64> Core64::map(std::size_t n) {
  core_.refuse_replacement(n);
  reserve(n);
  std::vector<std::uint32_t> added;
  for (std::uint32_t id = 0; id < n; ++id) {
    if (!contains(id)) added.push_back(id);
  }
  core_.map_packed(n);
  // Nothing below throws.
  for (const std::uint32_t id : added) (*boxes_)[id] = empty_aabb64();
  mapped_ = n;
  must_convert_ = must_convert_ || origin_.is_flat();  // what is written may have an extent in z
  return std::span(*boxes_).first(n);
}

bool Core64::must_choose() const noexcept {
  if (!has_origin_) return size() > 0;
  return updates_ >= updates_per_choice &&
         static_cast<double>(exact_.touching()) > touching_per_object * static_cast<double>(size());
}

Origin Core64::choose_origin() const {
  const Boxes& boxes = *boxes_;
  const auto samples = sample(boxes.size(), [&](std::size_t k) {
    return contains(static_cast<std::uint32_t>(k)) ? boxes[k] : empty_aabb64();
  });
  bool are_flat = true;
  for (std::uint32_t id = 0; are_flat && id < boxes.size(); ++id) {
    are_flat = !contains(id) || is_flat_or_empty(boxes[id]);
  }
  return best_origin(samples, are_flat);
}

Origin Core64::best_origin(std::span<const Aabb64> samples, bool are_flat) const {
  const Origin best(samples, are_flat);
  constexpr double enough = 0.5;
  const bool is_better = !has_origin_ || best.is_flat() != origin_.is_flat() ||
                         best.badness(samples) < enough * origin_.badness(samples);
  return is_better ? best : origin_;
}

void Core64::convert_all(const Origin& origin) {
  std::vector<std::uint32_t> ids;
  Boxes exact;
  ids.reserve(size());
  exact.reserve(size());
  for (std::uint32_t id = 0; ids.size() < size(); ++id) {
    if (!contains(id)) continue;
    if (id < mapped_ && has_nan((*boxes_)[id])) throw_nan("box " + std::to_string(id));
    ids.push_back(id);
    exact.push_back((*boxes_)[id]);
  }
  const Origin before = std::exchange(origin_, origin);
  try {
    const std::vector<Aabb> converted = convert(exact);
    core_.move(ids, converted);
  } catch (...) {
    origin_ = before;
    throw;
  }
  // Nothing below throws.
  must_convert_ = false;
  has_changed_ = true;
  mapped_ = 0;
}

void Core64::begin() {
  if (is_begun_) return;
  const bool chooses = must_choose() || must_convert_;
  const Origin origin = chooses ? choose_origin() : origin_;
  if (mapped_ > 0 || must_convert_ || origin != origin_) convert_all(origin);
  if (chooses) updates_ = 0;
  has_origin_ = has_origin_ || chooses;
  core_.begin();
  is_begun_ = true;
}

template <class Update>
void Core64::replace_all(const BoxView& boxes, const Update& update) {
  core_.refuse_replacement(boxes.size());
  Origin origin = origin_;
  const bool is_flat = boxes.are_flat();
  const bool chooses = !has_origin_ || must_choose() || is_flat != origin.is_flat();
  if (chooses)
    origin = best_origin(sample(boxes.size(), [&](std::size_t k) { return boxes.exact(k); }), is_flat);
  if (spare_ == nullptr || spare_->capacity() < boxes.size()) {
    spare_.reset();
    spare_ = std::make_shared<Boxes>();  // for somebody may keep the memory of map()
  }
  spare_->resize(boxes.size());
  const Conversion conversion{.origin = origin, .boxes = spare_->data()};
  BoxView converted = boxes;
  converted.conversion_ = &conversion;
  update(converted);
  // Nothing below throws.
  boxes_.swap(spare_);
  origin_ = origin;
  has_origin_ = boxes.size() > 0;
  if (chooses) updates_ = 0;
  must_convert_ = false;
  has_changed_ = true;
  mapped_ = 0;
}

void Core64::begin(const BoxView& boxes) {
  replace_all(boxes, [&](const BoxView& converted) { core_.begin(converted); });
  is_begun_ = true;
}

Delta Core64::update(const BoxView& boxes) {
  Delta delta;
  has_changed_ = true;
  replace_all(boxes, [&](const BoxView& converted) {
    delta = finish_core(*spare_, [&] { return core_.update(converted); });
  });
  has_changed_ = false;
  return delta;
}

void Core64::flush() {
  or_end_update([&] { core_.flush(); });
}

Delta Core64::finish() {
  begin();
  Delta delta;
  or_end_update([&] { delta = finish_core(*boxes_, [&] { return core_.finish(); }); });
  has_changed_ = false;
  end_update();
  return delta;
}

template <class Function>
void Core64::or_end_update(const Function& function) {
  try {
    function();
  } catch (...) {
    end_update();
    throw;
  }
}

void Core64::end_update() noexcept {
  is_begun_ = false;
  for (const auto& [id, box] : late_) store(id, box);
  late_.clear();
}

template <class Finish>
Delta Core64::finish_core(std::span<const Aabb64> boxes, const Finish& finish) {
  exact_.begin(boxes);
  const Delta found = finish();
  if (has_changed_) exact_.compare_again();
  // Nothing below throws.
  ++updates_;
  return exact_.commit(found);
}

void Core64::shrink() {
  std::size_t ids = boxes_->size();
  while (ids > 0 && !contains(static_cast<std::uint32_t>(ids - 1))) --ids;
  auto boxes = std::make_shared<Boxes>(boxes_->begin(), boxes_->begin() + static_cast<std::ptrdiff_t>(ids));
  core_.shrink();
  // Nothing below throws.
  boxes_ = std::move(boxes);
  spare_.reset();
  exact_.shrink();
  late_.shrink();
}

}  // namespace broadcl
