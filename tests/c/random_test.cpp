// Random calls of the C interface: ../core_random_test.cpp does the same in C++.
#include <broadcl/broadcl.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/aabb.hpp>
#include <broadcl/error.hpp>
#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

#include "../core_player.hpp"

namespace broadcl::test {
namespace {

static_assert(sizeof(broadcl_aabb) == sizeof(Aabb) && sizeof(broadcl_pair) == sizeof(Pair));

/// A BroadPhase through the C interface. Its calls throw what they report.
class CSubject {
 public:
  struct Changes {
    std::vector<Pair> added, removed;
  };

  explicit CSubject(const char* algorithm) {
    broadcl_config config{};
    config.size = sizeof config;
    config.algorithm = algorithm;
    check(broadcl_broad_phase_create(&config, &handle_));
  }
  ~CSubject() { (void)broadcl_broad_phase_destroy(handle_); }
  CSubject(const CSubject&) = delete;
  CSubject& operator=(const CSubject&) = delete;
  CSubject(CSubject&&) = delete;
  CSubject& operator=(CSubject&&) = delete;

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    const std::size_t filters = filter == Filter() ? 0 : 1;
    return add(BoxView(std::span(&box, 1)), {&filter, filters}).front();
  }
  std::vector<std::uint32_t> add(const BoxView& boxes, std::span<const Filter> filters) {
    const Boxes given(boxes);
    std::vector<broadcl_filter> rules;
    for (const Filter& filter : filters) rules.push_back(to_c(filter));
    std::vector<std::uint32_t> ids(boxes.size());
    check(broadcl_broad_phase_add(handle_, given.get(), rules.data(), rules.size(), ids.data()));
    return ids;
  }
  void move(std::uint32_t id, const Aabb& box) { move({&id, 1}, BoxView(std::span(&box, 1))); }
  void move(std::span<const std::uint32_t> ids, const BoxView& boxes) {
    const Boxes given(boxes);
    check(broadcl_broad_phase_move(handle_, ids.data(), ids.size(), given.get()));
  }
  void set_filter(std::uint32_t id, const Filter& filter) {
    const broadcl_filter given = to_c(filter);
    check(broadcl_broad_phase_set_filter(handle_, id, &given));
  }
  void set_filters(std::span<const std::uint32_t> ids, std::span<const Filter> filters) {
    std::vector<broadcl_filter> given;
    for (const Filter& filter : filters) given.push_back(to_c(filter));
    check(broadcl_broad_phase_set_filters(handle_, ids.data(), ids.size(), given.data(), given.size()));
  }
  void set_reach(std::span<const std::uint32_t> ids, std::span<const float> reaches) {
    const std::vector<double> given(reaches.begin(), reaches.end());
    check(broadcl_broad_phase_set_reach(handle_, ids.data(), ids.size(), given.data(), given.size()));
  }
  void remove(std::uint32_t id) { remove({&id, 1}); }
  void remove(std::span<const std::uint32_t> ids) {
    check(broadcl_broad_phase_remove(handle_, ids.data(), ids.size()));
  }
  bool contains(std::uint32_t id) {
    int is_there = 0;
    check(broadcl_broad_phase_contains(handle_, id, &is_there));
    return is_there != 0;
  }
  Aabb box(std::uint32_t id) {
    broadcl_aabb box{};
    check(broadcl_broad_phase_box(handle_, id, &box));
    return {{box.lower[0], box.lower[1], box.lower[2]}, {box.upper[0], box.upper[1], box.upper[2]}};
  }
  Filter filter(std::uint32_t id) {
    broadcl_filter filter{};
    check(broadcl_broad_phase_filter(handle_, id, &filter));
    return {.group = filter.group, .mask = filter.mask, .body = filter.body, .world = filter.world};
  }
  float reach(std::uint32_t id) {
    double reach = 0;
    check(broadcl_broad_phase_reach(handle_, id, &reach));
    return static_cast<float>(reach);
  }
  std::vector<std::uint32_t> ids() { return all<std::uint32_t>(broadcl_broad_phase_ids); }
  std::vector<Aabb> boxes() { return all<Aabb>(broadcl_broad_phase_boxes); }
  std::vector<Filter> filters() { return all<Filter>(broadcl_broad_phase_filters); }
  std::vector<float> reaches() {
    const std::vector<double> reaches = all<double>(broadcl_broad_phase_reaches);
    return {reaches.begin(), reaches.end()};
  }
  std::vector<Pair> exclusions() {
    broadcl_pairs pairs{};
    check(broadcl_broad_phase_exclusions(handle_, &pairs));
    return list(pairs);
  }
  broadcl_algorithm algorithm() {
    const broadcl_algorithm* row = nullptr;
    check(broadcl_broad_phase_algorithm(handle_, &row));
    return *row;
  }
  void set_exclusions(std::span<const Pair> pairs) {
    std::vector<broadcl_pair> given;
    for (const Pair& pair : pairs) given.push_back({pair.a, pair.b});
    check(broadcl_broad_phase_set_exclusions(handle_, given.data(), given.size()));
  }
  std::span<Aabb> map(std::size_t n) {
    broadcl_aabb* boxes = nullptr;
    check(broadcl_broad_phase_map(handle_, n, &boxes));
    return {reinterpret_cast<Aabb*>(boxes), n};
  }
  void begin() { check(broadcl_broad_phase_begin(handle_)); }
  void begin(const BoxView& boxes) { check(broadcl_broad_phase_begin_boxes(handle_, Boxes(boxes).get())); }
  Changes update(const BoxView& boxes) {
    broadcl_delta delta{};
    check(broadcl_broad_phase_update_boxes(handle_, Boxes(boxes).get(), &delta));
    return {list(delta.added), list(delta.removed)};
  }
  Changes update() {
    broadcl_delta delta{};
    check(broadcl_broad_phase_update(handle_, &delta));
    return {list(delta.added), list(delta.removed)};
  }
  Changes finish() {
    broadcl_delta delta{};
    check(broadcl_broad_phase_finish(handle_, &delta));
    return {list(delta.added), list(delta.removed)};
  }
  std::vector<std::byte> save() {
    const void* bytes = nullptr;
    std::size_t size = 0;
    check(broadcl_broad_phase_save(handle_, &bytes, &size));
    const auto* first = static_cast<const std::byte*>(bytes);
    return {first, first + size};
  }
  Changes restore(const std::vector<std::byte>& state) {
    broadcl_delta delta{};
    check(broadcl_broad_phase_restore(handle_, state.data(), state.size(), &delta));
    return {list(delta.added), list(delta.removed)};
  }
  void shrink() { check(broadcl_broad_phase_shrink(handle_)); }
  std::vector<Pair> pairs() {
    broadcl_pairs pairs{};
    check(broadcl_broad_phase_pairs(handle_, &pairs));
    return list(pairs);
  }
  Hits overlapping(const BoxView& boxes, const QueryOptions& options) {
    const Boxes given(boxes);
    return hits(options, [&](const broadcl_query_options& how, broadcl_hit_list** list) {
      return broadcl_broad_phase_overlapping(handle_, given.get(), &how, list);
    });
  }
  Hits nearest(const BoxView& boxes, const QueryOptions& options) {
    const Boxes given(boxes);
    return hits(options, [&](const broadcl_query_options& how, broadcl_hit_list** list) {
      return broadcl_broad_phase_nearest(handle_, given.get(), &how, list);
    });
  }
  Hits along(const BoxView& starts, std::span<const std::array<float, 3>> directions,
             std::span<const float> lengths, const QueryOptions& options) {
    const Boxes given(starts);
    std::vector<double> components;
    for (const std::array<float, 3>& direction : directions)
      components.insert(components.end(), direction.begin(), direction.end());
    const std::vector<double> given_lengths(lengths.begin(), lengths.end());
    return hits(options, [&](const broadcl_query_options& how, broadcl_hit_list** list) {
      return broadcl_broad_phase_along(handle_, given.get(), components.data(), directions.size(),
                                       given_lengths.data(), given_lengths.size(), &how, list);
    });
  }
  std::vector<std::uint32_t> partners(std::uint32_t id) {
    const std::uint32_t* ids = nullptr;
    std::size_t count = 0;
    check(broadcl_broad_phase_partners(handle_, id, &ids, &count));
    return {ids, ids + count};
  }
  [[nodiscard]] std::size_t size() const {
    std::size_t count = 0;
    check(broadcl_broad_phase_size(handle_, &count));
    return count;
  }

 private:
  /// Boxes of a view, in the C interface.
  class Boxes {
   public:
    explicit Boxes(const BoxView& view) : copy_(view.size()) {
      view.copy_to(copy_);
      boxes_.size = sizeof boxes_;
      boxes_.data = copy_.data();
      boxes_.count = copy_.size();
    }
    [[nodiscard]] const broadcl_boxes* get() const { return &boxes_; }

   private:
    std::vector<Aabb> copy_;
    broadcl_boxes boxes_{};
  };

  /// What a function returns for all objects.
  template <class Value, class Item>
  std::vector<Value> all(broadcl_status (*function)(broadcl_broad_phase*, const Item**, std::size_t*)) {
    const Item* items = nullptr;
    std::size_t count = 0;
    check(function(handle_, &items, &count));
    const auto* values = reinterpret_cast<const Value*>(items);
    return {values, values + count};
  }

  /// What queries find with options.
  template <class Ask>
  static Hits hits(const QueryOptions& options, const Ask& ask) {
    std::vector<broadcl_filter> rules;
    for (const Filter& filter : options.filters) rules.push_back(to_c(filter));
    broadcl_query_options given{};
    given.size = sizeof given;
    given.filters = rules.data();
    given.filter_count = rules.size();
    given.except = options.except.data();
    given.except_count = options.except.size();
    given.within = options.within.value_or(0);
    given.limit = options.limit == QueryOptions::all ? 0 : options.limit;
    given.count_only = options.count_only ? 1 : 0;
    broadcl_hit_list* list = nullptr;
    check(ask(given, &list));
    broadcl_hits found{};
    check(broadcl_hit_list_hits(list, &found));
    Hits result{.offsets = {found.offsets, found.offsets + found.query_count + 1}};
    const auto take = [&](const auto* items, auto& to) {
      if (items != nullptr) to.assign(items, items + result.offsets.back());
    };
    take(found.ids, result.ids);
    take(found.squared_distances, result.squared_distances);
    take(found.times, result.times);
    check(broadcl_hit_list_destroy(list));
    return result;
  }
  static void check(broadcl_status status) {
    if (status != BROADCL_SUCCESS) throw Error(broadcl_last_error());
  }
  static broadcl_filter to_c(const Filter& filter) {
    broadcl_filter result = BROADCL_DEFAULT_FILTER;
    result.group = filter.group;
    result.mask = filter.mask;
    result.body = filter.body;
    result.world = filter.world;
    return result;
  }
  static std::vector<Pair> list(const broadcl_pairs& pairs) {
    std::vector<Pair> result;
    for (std::size_t k = 0; k < pairs.count; ++k) result.push_back({pairs.data[k].a, pairs.data[k].b});
    return result;
  }

  broadcl_broad_phase* handle_ = nullptr;
};

TEST(CRandom, SomeRandomCalls) {
  for (const char* algorithm : {"sweep-and-prune", "brute-force"}) {
    check_core_scripts(std::string("C, ") + algorithm, ScriptSize::small, 15, seed_of_ci,
                       [&] { return std::make_unique<CSubject>(algorithm); });
  }
}

}  // namespace
}  // namespace broadcl::test
