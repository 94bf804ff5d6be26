#include <broadcl/broadcl.h>
#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "c/call.hpp"
#include "c/convert.hpp"

struct broadcl_pair_list {
  std::vector<broadcl::Pair> pairs;
};

struct broadcl_hit_list {
  broadcl::Hits hits;
};

struct broadcl_broad_phase {
  /// What functions have returned, each under its name.
  struct Lists {
    std::vector<broadcl::Pair> pairs{}, exclusions{};
    std::vector<std::uint32_t> partners{}, ids{};
    std::vector<broadcl::Aabb> boxes{};
    std::vector<broadcl::Aabb64> boxes64{};
    std::vector<broadcl::Filter> filters{};
    std::vector<double> reaches{};
  };

  std::variant<broadcl::BroadPhase, broadcl::BroadPhase64> broad_phase;
  Lists lists{};
  std::vector<std::byte> state{};                   ///< What broadcl_broad_phase_save() has returned,
  std::optional<broadcl::c::DeviceFacts> device{};  ///< ..._device(),
  std::vector<broadcl_stage> stages{};              ///< and ..._profile().
};

using namespace broadcl;

namespace {

using Lists = broadcl_broad_phase::Lists;

/// Calls a function with the object of a handle.
template <class Handle, class Function>
auto with(Handle* handle, const Function& function) {
  return std::visit(function, c::required(handle, "broad_phase").broad_phase);
}

/// The object of a handle, which must have boxes of a type.
/// @param remedy What to call if it has those of the other.
template <class Object, class Handle>
auto& of_type(Handle* handle, const char* remedy) {
  auto* object = std::get_if<Object>(&c::required(handle, "broad_phase").broad_phase);
  if (object == nullptr) {
    throw Error::invalid_argument(std::string("the boxes are of the other type; call ") + remedy);
  }
  return *object;
}

void finish(broadcl_broad_phase* broad_phase, broadcl_delta* delta) {
  const Delta changes = with(broad_phase, [](auto& object) { return object.finish(); });
  if (delta != nullptr) *delta = c::to_c(changes);
}

/// Stores a list in a handle, and returns it.
/// @param make Makes it, of the object.
/// @param name Of the parameter `items`.
template <class Value, class Function, class Item>
broadcl_status give(const char* function, broadcl_broad_phase* broad_phase, std::vector<Value> Lists::*list,
                    const Function& make, const char* name, const Item** items, std::size_t* count) {
  return c::call(function, [&] {
    c::required(items, name);
    c::required(count, "count");
    std::vector<Value>& stored = c::required(broad_phase, "broad_phase").lists.*list;
    stored = with(broad_phase, make);
    *items = reinterpret_cast<const Item*>(stored.data());
    *count = stored.size();
  });
}

/// The same for pairs.
template <class Function>
broadcl_status give(const char* function, broadcl_broad_phase* broad_phase, std::vector<Pair> Lists::*list,
                    const Function& make, broadcl_pairs* pairs) {
  return give(function, broad_phase, list, make, "pairs", pairs == nullptr ? nullptr : &pairs->data,
              pairs == nullptr ? nullptr : &pairs->count);
}

/// Makes a list of what queries find.
/// @param search Gets their boxes and options.
template <class Search>
broadcl_status list_hits(const char* function, const broadcl_boxes* queries, const char* name,
                         const broadcl_query_options* options, broadcl_hit_list** list,
                         const Search& search) {
  return c::call(function, [&] {
    c::required(list, "list");
    const BoxView view = c::to_view(queries, name);
    *list = new broadcl_hit_list{search(view, c::to_options(options))};
  });
}

std::span<const std::array<double, 3>> to_directions(const double* numbers, std::size_t count) {
  return c::array(reinterpret_cast<const std::array<double, 3>*>(numbers), count, "directions");
}

}  // namespace

broadcl_status broadcl_pair_list_create(const broadcl_boxes* boxes, const broadcl_boxes* second,
                                        const broadcl_pair* exclusions, std::size_t count,
                                        const broadcl_config* config, broadcl_pair_list** list) {
  return c::call(__func__, [&] {
    c::required(list, "list");
    const BoxView view = c::to_view(boxes, "boxes");
    const std::span<const Pair> without = c::to_pairs(exclusions, count, "exclusions");
    *list = new broadcl_pair_list{second == nullptr ? overlapping_pairs(view, without, c::to_config(config))
                                                    : overlapping_pairs(view, c::to_view(second, "second"),
                                                                        without, c::to_config(config))};
  });
}

broadcl_status broadcl_pair_list_create_sharing(const std::uint32_t* labels, std::size_t count,
                                                std::size_t per_object, const std::uint32_t* second_labels,
                                                std::size_t second_count, std::size_t per_second,
                                                broadcl_pair_list** list) {
  return c::call(__func__, [&] {
    c::required(list, "list");
    const std::span<const std::uint32_t> first = c::array(labels, count, "labels");
    const std::span<const std::uint32_t> second = c::array(second_labels, second_count, "second_labels");
    const bool is_one_set = second.empty() && per_second == 0;
    *list = new broadcl_pair_list{is_one_set ? pairs_that_share(first, per_object)
                                             : pairs_that_share(first, per_object, second, per_second)};
  });
}

broadcl_status broadcl_pair_list_destroy(broadcl_pair_list* list) {
  return c::call(__func__, [&] { delete list; });
}

broadcl_status broadcl_pair_list_pairs(const broadcl_pair_list* list, broadcl_pairs* pairs) {
  return c::call(__func__, [&] { c::required(pairs, "pairs") = c::to_c(c::required(list, "list").pairs); });
}

broadcl_status broadcl_hit_list_create(const broadcl_boxes* boxes, const broadcl_boxes* queries,
                                       const broadcl_query_options* options, const broadcl_config* config,
                                       broadcl_hit_list** list) {
  return list_hits(__func__, queries, "queries", options, list,
                   [&](const BoxView& view, const QueryOptions& how) {
                     return overlapping(c::to_view(boxes, "boxes"), view, how, c::to_config(config));
                   });
}

broadcl_status broadcl_hit_list_create_nearest(const broadcl_boxes* boxes, const broadcl_boxes* queries,
                                               const broadcl_query_options* options,
                                               const broadcl_config* config, broadcl_hit_list** list) {
  return list_hits(__func__, queries, "queries", options, list,
                   [&](const BoxView& view, const QueryOptions& how) {
                     return nearest(c::to_view(boxes, "boxes"), view, how, c::to_config(config));
                   });
}

broadcl_status broadcl_hit_list_create_along(const broadcl_boxes* boxes, const broadcl_boxes* starts,
                                             const double* directions, std::size_t direction_count,
                                             const double* lengths, std::size_t length_count,
                                             const broadcl_query_options* options,
                                             const broadcl_config* config, broadcl_hit_list** list) {
  return list_hits(
      __func__, starts, "starts", options, list, [&](const BoxView& view, const QueryOptions& how) {
        return along(c::to_view(boxes, "boxes"), view, to_directions(directions, direction_count),
                     c::array(lengths, length_count, "lengths"), how, c::to_config(config));
      });
}

broadcl_status broadcl_hit_list_destroy(broadcl_hit_list* list) {
  return c::call(__func__, [&] { delete list; });
}

broadcl_status broadcl_hit_list_hits(const broadcl_hit_list* list, broadcl_hits* hits) {
  return c::call(__func__, [&] {
    const Hits& found = c::required(list, "list").hits;
    const auto data = [](const auto& items) { return items.empty() ? nullptr : items.data(); };
    c::required(hits, "hits") = {found.offsets.data(), found.size(), data(found.ids),
                                 data(found.squared_distances), data(found.times)};
  });
}

broadcl_status broadcl_squared_distances(const broadcl_boxes* boxes, const broadcl_boxes* second,
                                         const broadcl_pair* pairs, std::size_t count,
                                         const broadcl_config* config, double* distances) {
  return c::call(__func__, [&] {
    const BoxView view = c::to_view(boxes, "boxes");
    const std::span<const Pair> of = c::to_pairs(pairs, count, "pairs");
    if (count > 0) c::required(distances, "distances");
    std::ranges::copy(squared_distances(view, second == nullptr ? view : c::to_view(second, "second"), of,
                                        c::to_config(config)),
                      distances);
  });
}

broadcl_status broadcl_broad_phase_create(const broadcl_config* config, broadcl_broad_phase** broad_phase) {
  return c::call(__func__, [&] {
    c::required(broad_phase, "broad_phase");
    if (c::is_float64(config)) {
      *broad_phase = new broadcl_broad_phase{.broad_phase = BroadPhase64(c::to_config(config))};
    } else {
      *broad_phase = new broadcl_broad_phase{.broad_phase = BroadPhase(c::to_config(config))};
    }
  });
}

broadcl_status broadcl_broad_phase_destroy(broadcl_broad_phase* broad_phase) {
  return c::call(__func__, [&] { delete broad_phase; });
}

broadcl_status broadcl_broad_phase_add(broadcl_broad_phase* broad_phase, const broadcl_boxes* boxes,
                                       const broadcl_filter* filters, std::size_t filter_count,
                                       std::uint32_t* ids) {
  return c::call(__func__, [&] {
    const BoxView view = c::to_view(boxes, "boxes");
    if (view.size() > 0) c::required(ids, "ids");
    const Filter none;
    const std::span<const Filter> rules =
        filter_count == 0 ? std::span(&none, 1) : c::to_filters(filters, filter_count, "filters");
    std::ranges::copy(with(broad_phase, [&](auto& object) { return object.add(view, rules); }), ids);
  });
}

broadcl_status broadcl_broad_phase_move(broadcl_broad_phase* broad_phase, const std::uint32_t* ids,
                                        std::size_t count, const broadcl_boxes* boxes) {
  return c::call(__func__, [&] {
    const std::span<const std::uint32_t> objects = c::array(ids, count, "ids");
    const BoxView view = c::to_view(boxes, "boxes");
    with(broad_phase, [&](auto& object) { object.move(objects, view); });
  });
}

broadcl_status broadcl_broad_phase_set_filter(broadcl_broad_phase* broad_phase, std::uint32_t id,
                                              const broadcl_filter* filter) {
  return c::call(__func__, [&] {
    const Filter rule = c::to_filter(c::required(filter, "filter"));
    with(broad_phase, [&](auto& object) { object.set_filter(id, rule); });
  });
}

broadcl_status broadcl_broad_phase_set_filters(broadcl_broad_phase* broad_phase, const std::uint32_t* ids,
                                               std::size_t count, const broadcl_filter* filters,
                                               std::size_t filter_count) {
  return c::call(__func__, [&] {
    const std::span<const std::uint32_t> objects = c::array(ids, count, "ids");
    const std::span<const Filter> rules = c::to_filters(filters, filter_count, "filters");
    with(broad_phase, [&](auto& object) { object.set_filters(objects, rules); });
  });
}

broadcl_status broadcl_broad_phase_set_reach(broadcl_broad_phase* broad_phase, const std::uint32_t* ids,
                                             std::size_t count, const double* reaches,
                                             std::size_t reach_count) {
  return c::call(__func__, [&] {
    const std::span<const std::uint32_t> objects = c::array(ids, count, "ids");
    const std::span<const double> given = c::array(reaches, reach_count, "reaches");
    with(broad_phase, [&]<class Box>(BasicBroadPhase<Box>& object) {
      using Bound = typename BasicBroadPhase<Box>::Bound;
      object.set_reach(objects, std::vector<Bound>(given.begin(), given.end()));
    });
  });
}

broadcl_status broadcl_broad_phase_remove(broadcl_broad_phase* broad_phase, const std::uint32_t* ids,
                                          std::size_t count) {
  return c::call(__func__, [&] {
    const std::span<const std::uint32_t> objects = c::array(ids, count, "ids");
    with(broad_phase, [&](auto& object) { object.remove(objects); });
  });
}

broadcl_status broadcl_broad_phase_contains(const broadcl_broad_phase* broad_phase, std::uint32_t id,
                                            int* contains) {
  return c::call(__func__, [&] {
    int& out = c::required(contains, "contains");
    out = with(broad_phase, [&](const auto& object) { return object.contains(id); }) ? 1 : 0;
  });
}

broadcl_status broadcl_broad_phase_box(const broadcl_broad_phase* broad_phase, std::uint32_t id,
                                       broadcl_aabb* box) {
  return c::call(__func__, [&] {
    broadcl_aabb& out = c::required(box, "box");
    out = c::to_c(of_type<BroadPhase>(broad_phase, "broadcl_broad_phase_box64()").box(id));
  });
}

broadcl_status broadcl_broad_phase_box64(const broadcl_broad_phase* broad_phase, std::uint32_t id,
                                         broadcl_aabb64* box) {
  return c::call(__func__, [&] {
    broadcl_aabb64& out = c::required(box, "box");
    out = c::to_c(of_type<BroadPhase64>(broad_phase, "broadcl_broad_phase_box()").box(id));
  });
}

broadcl_status broadcl_broad_phase_filter(const broadcl_broad_phase* broad_phase, std::uint32_t id,
                                          broadcl_filter* filter) {
  return c::call(__func__, [&] {
    broadcl_filter& out = c::required(filter, "filter");
    out = c::to_c(with(broad_phase, [&](const auto& object) { return object.filter(id); }));
  });
}

broadcl_status broadcl_broad_phase_reach(const broadcl_broad_phase* broad_phase, std::uint32_t id,
                                         double* reach) {
  return c::call(__func__, [&] {
    c::required(reach, "reach") =
        with(broad_phase, [&](const auto& object) { return static_cast<double>(object.reach(id)); });
  });
}

broadcl_status broadcl_broad_phase_ids(broadcl_broad_phase* broad_phase, const std::uint32_t** ids,
                                       std::size_t* count) {
  const auto all = [](const auto& object) { return object.ids(); };
  return give(__func__, broad_phase, &Lists::ids, all, "ids", ids, count);
}

broadcl_status broadcl_broad_phase_boxes(broadcl_broad_phase* broad_phase, const broadcl_aabb** boxes,
                                         std::size_t* count) {
  const auto all = [&](const auto& /*object*/) {
    return of_type<BroadPhase>(broad_phase, "broadcl_broad_phase_boxes64()").boxes();
  };
  return give(__func__, broad_phase, &Lists::boxes, all, "boxes", boxes, count);
}

broadcl_status broadcl_broad_phase_boxes64(broadcl_broad_phase* broad_phase, const broadcl_aabb64** boxes,
                                           std::size_t* count) {
  const auto all = [&](const auto& /*object*/) {
    return of_type<BroadPhase64>(broad_phase, "broadcl_broad_phase_boxes()").boxes();
  };
  return give(__func__, broad_phase, &Lists::boxes64, all, "boxes", boxes, count);
}

broadcl_status broadcl_broad_phase_filters(broadcl_broad_phase* broad_phase, const broadcl_filter** filters,
                                           std::size_t* count) {
  const auto all = [](const auto& object) { return object.filters(); };
  return give(__func__, broad_phase, &Lists::filters, all, "filters", filters, count);
}

broadcl_status broadcl_broad_phase_reaches(broadcl_broad_phase* broad_phase, const double** reaches,
                                           std::size_t* count) {
  const auto all = [](const auto& object) {
    const auto list = object.reaches();
    return std::vector<double>(list.begin(), list.end());
  };
  return give(__func__, broad_phase, &Lists::reaches, all, "reaches", reaches, count);
}

broadcl_status broadcl_broad_phase_exclusions(broadcl_broad_phase* broad_phase, broadcl_pairs* pairs) {
  const auto all = [](const auto& object) { return object.exclusions(); };
  return give(__func__, broad_phase, &Lists::exclusions, all, pairs);
}

broadcl_status broadcl_broad_phase_set_exclusions(broadcl_broad_phase* broad_phase, const broadcl_pair* pairs,
                                                  std::size_t count) {
  return c::call(__func__, [&] {
    const std::span<const Pair> exclusions = c::to_pairs(pairs, count, "pairs");
    with(broad_phase, [&](auto& object) { object.set_exclusions(exclusions); });
  });
}

broadcl_status broadcl_broad_phase_map(broadcl_broad_phase* broad_phase, std::size_t count,
                                       broadcl_aabb** boxes) {
  return c::call(__func__, [&] {
    c::required(boxes, "boxes");
    *boxes = reinterpret_cast<broadcl_aabb*>(
        of_type<BroadPhase>(broad_phase, "broadcl_broad_phase_map64()").map(count).data());
  });
}

broadcl_status broadcl_broad_phase_map64(broadcl_broad_phase* broad_phase, std::size_t count,
                                         broadcl_aabb64** boxes) {
  return c::call(__func__, [&] {
    c::required(boxes, "boxes");
    *boxes = reinterpret_cast<broadcl_aabb64*>(
        of_type<BroadPhase64>(broad_phase, "broadcl_broad_phase_map()").map(count).data());
  });
}

broadcl_status broadcl_broad_phase_update(broadcl_broad_phase* broad_phase, broadcl_delta* delta) {
  return c::call(__func__, [&] { finish(broad_phase, delta); });
}

broadcl_status broadcl_broad_phase_update_boxes(broadcl_broad_phase* broad_phase, const broadcl_boxes* boxes,
                                                broadcl_delta* delta) {
  return c::call(__func__, [&] {
    const BoxView view = c::to_view(boxes, "boxes");
    const Delta changes = with(broad_phase, [&](auto& object) { return object.update(view); });
    if (delta != nullptr) *delta = c::to_c(changes);
  });
}

broadcl_status broadcl_broad_phase_begin_boxes(broadcl_broad_phase* broad_phase, const broadcl_boxes* boxes) {
  return c::call(__func__, [&] {
    const BoxView view = c::to_view(boxes, "boxes");
    with(broad_phase, [&](auto& object) { object.begin(view); });
  });
}

broadcl_status broadcl_broad_phase_begin(broadcl_broad_phase* broad_phase) {
  return c::call(__func__, [&] { with(broad_phase, [](auto& object) { object.begin(); }); });
}

broadcl_status broadcl_broad_phase_finish(broadcl_broad_phase* broad_phase, broadcl_delta* delta) {
  return c::call(__func__, [&] { finish(broad_phase, delta); });
}

broadcl_status broadcl_broad_phase_save(broadcl_broad_phase* broad_phase, const void** bytes,
                                        std::size_t* size) {
  return c::call(__func__, [&] {
    const void*& first = c::required(bytes, "bytes");
    std::size_t& count = c::required(size, "size");
    const auto save = [](auto& object) { return object.save().bytes(); };
    broad_phase->state = with(broad_phase, save);  // which refuses null
    first = broad_phase->state.data();
    count = broad_phase->state.size();
  });
}

broadcl_status broadcl_broad_phase_restore(broadcl_broad_phase* broad_phase, const void* bytes,
                                           std::size_t size, broadcl_delta* delta) {
  return c::call(__func__, [&] {
    const auto state = c::array(static_cast<const std::byte*>(bytes), size, "bytes");
    const Delta changes = with(broad_phase, [&]<class Box>(BasicBroadPhase<Box>& object) {
      return object.restore(BasicState<Box>::from_bytes(state));
    });
    if (delta != nullptr) *delta = c::to_c(changes);
  });
}

broadcl_status broadcl_broad_phase_shrink(broadcl_broad_phase* broad_phase) {
  return c::call(__func__, [&] {
    with(broad_phase, [](auto& object) { object.shrink(); });
    broad_phase->lists = {};
  });
}

broadcl_status broadcl_broad_phase_pairs(broadcl_broad_phase* broad_phase, broadcl_pairs* pairs) {
  const auto all = [](const auto& object) { return object.pairs(); };
  return give(__func__, broad_phase, &Lists::pairs, all, pairs);
}

broadcl_status broadcl_broad_phase_partners(broadcl_broad_phase* broad_phase, std::uint32_t id,
                                            const std::uint32_t** ids, std::size_t* count) {
  const auto partners = [&](const auto& object) { return object.partners(id); };
  return give(__func__, broad_phase, &Lists::partners, partners, "ids", ids, count);
}

broadcl_status broadcl_broad_phase_overlapping(const broadcl_broad_phase* broad_phase,
                                               const broadcl_boxes* boxes,
                                               const broadcl_query_options* options,
                                               broadcl_hit_list** list) {
  return list_hits(
      __func__, boxes, "boxes", options, list, [&](const BoxView& view, const QueryOptions& how) {
        return with(broad_phase, [&](const auto& object) { return object.overlapping(view, how); });
      });
}

broadcl_status broadcl_broad_phase_nearest(const broadcl_broad_phase* broad_phase, const broadcl_boxes* boxes,
                                           const broadcl_query_options* options, broadcl_hit_list** list) {
  return list_hits(__func__, boxes, "boxes", options, list,
                   [&](const BoxView& view, const QueryOptions& how) {
                     return with(broad_phase, [&](const auto& object) { return object.nearest(view, how); });
                   });
}

broadcl_status broadcl_broad_phase_along(const broadcl_broad_phase* broad_phase, const broadcl_boxes* starts,
                                         const double* directions, std::size_t direction_count,
                                         const double* lengths, std::size_t length_count,
                                         const broadcl_query_options* options, broadcl_hit_list** list) {
  return list_hits(
      __func__, starts, "starts", options, list, [&](const BoxView& view, const QueryOptions& how) {
        return with(broad_phase, [&]<class Box>(const BasicBroadPhase<Box>& object) {
          using Bound = typename BasicBroadPhase<Box>::Bound;
          std::vector<std::array<Bound, 3>> ways;
          for (const auto& [x, y, z] : to_directions(directions, direction_count))
            ways.push_back({static_cast<Bound>(x), static_cast<Bound>(y), static_cast<Bound>(z)});
          const std::span<const double> given = c::array(lengths, length_count, "lengths");
          return object.along(view, ways, std::vector<Bound>(given.begin(), given.end()), how);
        });
      });
}

broadcl_status broadcl_broad_phase_size(const broadcl_broad_phase* broad_phase, std::size_t* size) {
  return c::call(__func__, [&] {
    c::required(size, "size") = with(broad_phase, [](const auto& object) { return object.size(); });
  });
}

broadcl_status broadcl_broad_phase_device(broadcl_broad_phase* broad_phase, broadcl_device_info* info) {
  return c::call(__func__, [&] {
    const c::Out out(info, "info");
    broadcl_broad_phase& handle = c::required(broad_phase, "broad_phase");
    const Device* device = with(&handle, [](const auto& object) { return object.device(); });
    if (device == nullptr) {
      out.write({});
    } else {
      out.write(handle.device.emplace(*device).info());
    }
  });
}

broadcl_status broadcl_broad_phase_algorithm(const broadcl_broad_phase* broad_phase,
                                             const broadcl_algorithm** row) {
  return c::call(__func__, [&] {
    c::required(row, "row") =
        &c::row_of(*with(broad_phase, [](const auto& object) { return &object.algorithm(); }));
  });
}

broadcl_status broadcl_broad_phase_memory(const broadcl_broad_phase* broad_phase, broadcl_memory_use* use) {
  return c::call(__func__, [&] {
    const c::Out out(use, "use");
    out.write(c::to_c(with(broad_phase, [](const auto& object) { return object.memory(); })));
  });
}

broadcl_status broadcl_broad_phase_profile(broadcl_broad_phase* broad_phase, const broadcl_stage** stages,
                                           std::size_t* count) {
  return c::call(__func__, [&] {
    c::required(stages, "stages");
    c::required(count, "count");
    broadcl_broad_phase& handle = c::required(broad_phase, "broad_phase");
    handle.stages = c::to_c(with(&handle, [](const auto& object) { return object.profile(); }));
    *stages = handle.stages.data();
    *count = handle.stages.size();
  });
}
