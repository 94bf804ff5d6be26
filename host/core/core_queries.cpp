#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/core.hpp"
#include "engines/box_tree.hpp"

/// What queries need of a core.
namespace broadcl {

template <class Box>
BoxTree& Core<Box>::choose_tree() {
  BoxTree* const tree = algorithm_->tree();
  if (tree != nullptr) {
    if (own_tree_) {  // another algorithm does the updates now, which has not read what that tree has
      changes_.reserve(capacity_);
      changes_.insert(read_);
      read_.clear();
      unread_.clear();
      own_tree_.reset();
    }
    return *tree;
  }
  if (!own_tree_) {
    own_tree_ = make_box_tree(threads_);
    unread_.all = true;
  }
  return *own_tree_;
}

/// Calls a function with each set of changes that may not be in the tree.
/// @returns Whether all boxes may be others.
template <class Box>
template <class Function>
bool Core<Box>::for_each_unread(const Function& function) const {
  const BoxTree* const tree = own_tree_ ? own_tree_.get() : algorithm_->tree();
  bool all = mapped_ > 0 || tree == nullptr || !tree->is_ready();
  const auto look = [&](const ChangeSet& changes) {
    all = all || changes.all;
    function(changes.changed());
  };
  look(changes_);
  look(unread_);
  if (is_in_flight() && !own_tree_ && !unread_slots_) look(flight_);
  return all;
}

template <class Box>
std::optional<std::vector<std::uint32_t>> Core<Box>::unread() const {
  std::vector<std::uint32_t> ids;
  const auto append = [&](std::span<const std::uint32_t> some) {
    ids.insert(ids.end(), some.begin(), some.end());
  };
  if (for_each_unread(append)) return std::nullopt;
  for (const auto& late : late_) ids.push_back(late.id);
  std::ranges::sort(ids);
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

template <class Box>
std::size_t Core<Box>::count_unread() noexcept {
  std::size_t count = late_.empty() ? 0 : 1;  // all of them are in flight or changed, too
  const bool all = for_each_unread([&](std::span<const std::uint32_t> some) { count += some.size(); });
  return all ? objects_.slots() : count;
}

template <class Box>
void Core<Box>::copy_to(Core& core, std::size_t slots) const {
  std::vector<Box> boxes(slots);
  for (std::uint32_t id = 0; id < boxes.size(); ++id) {
    const Box box = packed_box(id);
    boxes[id] = has_nan(box) ? empty_box : box;
  }
  constexpr Filter any{};
  (void)core.add(boxes, objects_.any_filters() ? objects_.filters().first(slots) : std::span(&any, 1),
                 objects_.any_reaches() ? objects_.reaches().first(slots) : std::span<const Bound>());
}

template <class Box>
void Core<Box>::read() {
  read_.reserve(capacity_);
  unread_.reserve(capacity_);
  reserve_algorithm(objects_.ids(), objects_.any_filters());
  convert_changed(false);
  unread_.insert(changes_);
  const std::size_t slots = objects_.slots();
  const bool all = unread_.all || unread_.changed().size() > slots / 4;
  const Input input{.boxes = algorithm_->boxes().first(slots),
                    .changed = {.all = all, .slots = unread_.changed()},
                    .rules = rules()};
  own_tree_ ? own_tree_->read(input) : algorithm_->read(input);
  // Nothing below throws.
  unread_.clear();
  read_.insert(changes_);
  changes_.clear();
}

template BoxTree& Core<Aabb>::choose_tree();
template BoxTree& Core<Aabb64>::choose_tree();
template std::optional<std::vector<std::uint32_t>> Core<Aabb>::unread() const;
template std::optional<std::vector<std::uint32_t>> Core<Aabb64>::unread() const;
template std::size_t Core<Aabb>::count_unread() noexcept;
template std::size_t Core<Aabb64>::count_unread() noexcept;
template void Core<Aabb>::copy_to(Core& core, std::size_t slots) const;
template void Core<Aabb64>::copy_to(Core& core, std::size_t slots) const;
template void Core<Aabb>::read();
template void Core<Aabb64>::read();

}  // namespace broadcl
