#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "arrays.hpp"
#include "box_array.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "gil.hpp"
#include "inverted_boxes.hpp"
#include "keywords.hpp"
#include "one_thread.hpp"
#include "profile.hpp"
#include "query.hpp"
#include "state.hpp"

namespace broadcl::python {

template <class Function>
auto without_gil(const Function& function) {
  const GilReleased released;
  return function();
}

/// A BroadPhase or a BroadPhase64 for Python: one thread at a time, all or nothing for arrays too, and arrays
/// that live as long as anybody looks at them.
class Objects {
  using Either = std::variant<BroadPhase, BroadPhase64>;

  template <class Function>
  auto with(const Function& function) {
    return std::visit(function, *broad_phase_);
  }

 public:
  /// @param in_double Whether boxes are float64.
  Objects(const Config& config, bool in_double)
      : config_(config), broad_phase_(without_gil([&] {
          return in_double ? Either(std::in_place_type<BroadPhase64>, config)
                           : Either(std::in_place_type<BroadPhase>, config);
        })) {}
  Objects(const Objects&) = delete;
  Objects& operator=(const Objects&) = delete;
  /// May wait for the thread that opens a device.
  ~Objects() {
    const GilReleased released;
    const std::optional<Either> last = std::move(broad_phase_);
  }

  nanobind::object add(nanobind::handle boxes, nanobind::handle group, nanobind::handle mask,
                       nanobind::handle body, nanobind::handle world, nanobind::handle reach,
                       const std::string& layout) {
    const BoxArray array(boxes, "boxes", layout);
    const std::vector<Filter> filters = Filters(group, mask, body, world, array.view().size()).list();
    std::vector<double> reaches = to_numbers(reach, "reach");
    if (reaches == std::vector{0.0}) reaches.clear();
    warn_of_inverted({&array});
    const OneThread::Use use(thread_);
    take_mapped();
    // First, because memory may run out.
    std::vector<std::uint32_t> ids(array.view().size());
    const std::span<std::uint32_t> out(ids);
    nanobind::object result = to_array(std::move(ids));
    or_name_row(array, [&] {
      std::ranges::copy(
          with([&](auto& object) { return object.add(array.view(), filters, bounds_for(object, reaches)); }),
          out.begin());
    });
    if (!array.is_single()) return result;
    try {
      return nanobind::int_(out.front());
    } catch (...) {
      with([&](auto& object) { object.remove(out.front()); });
      throw;
    }
  }

  void move(nanobind::handle ids, nanobind::handle boxes, const std::string& layout) {
    const Words words(ids, "ids");
    const BoxArray array(boxes, "boxes", layout);
    if (words.is_single() != array.is_single() && words.size() == array.view().size()) {
      throw nanobind::value_error(
          "move() needs one id and one box, or arrays of both; not one and an array of one");
    }
    if (words.size() != array.view().size()) {
      throw nanobind::value_error(("move() needs one id and one box, or as many ids as boxes; not " +
                                   std::to_string(words.size()) + " and " +
                                   std::to_string(array.view().size()))
                                      .c_str());
    }
    warn_of_inverted({&array});
    const OneThread::Use use(thread_);
    take_mapped();
    or_name_row(array, [&] { with([&](auto& object) { object.move(words.all(), array.view()); }); });
  }

  void set_filter(nanobind::handle ids, nanobind::handle group, nanobind::handle mask, nanobind::handle body,
                  nanobind::handle world) {
    const Words words(ids, "ids");
    const std::vector<Filter> filters = Filters(group, mask, body, world, words.size()).list();
    const OneThread::Use use(thread_);
    take_mapped();
    with([&](auto& object) { object.set_filters(words.all(), filters); });
  }

  void set_reach(nanobind::handle ids, nanobind::handle reaches) {
    const Words words(ids, "ids");
    const std::vector<double> numbers = to_numbers(reaches, "reaches");
    const OneThread::Use use(thread_);
    take_mapped();
    with([&](auto& object) { object.set_reach(words.all(), bounds_for(object, numbers)); });
  }

  void remove(nanobind::handle ids) {
    const Words words(ids, "ids");
    const OneThread::Use use(thread_);
    take_mapped();
    without_gil([&] { with([&](auto& object) { object.remove(words.all()); }); });
  }

  void set_exclusions(nanobind::handle pairs) {
    const std::vector<Pair> exclusions = to_exclusions(pairs);
    const OneThread::Use use(thread_);
    take_mapped();
    const GilReleased released;
    with([&](auto& object) { object.set_exclusions(exclusions); });
  }

  void shrink() {
    const OneThread::Use use(thread_);
    refuse_unreturned();
    take_mapped();
    const GilReleased released;
    with([](auto& object) { object.shrink(); });
  }

  nanobind::object map(std::optional<std::size_t> number) {
    const std::size_t n = required(number, "n");
    refuse_too_many(n);
    const OneThread::Use use(thread_);
    try {
      array_ = with([&](auto& object) { return array_of_map(object, n); });
    } catch (const Error&) {  // `auto` leaves a device that failed, and its memory
      take_mapped();
      throw;
    }
    return array_;
  }

  nanobind::object update(nanobind::handle boxes, const std::string& layout) {
    if (boxes.is_none()) {
      return changes(
          [&] { or_refuse_nan([&] { delta_ = with([](auto& object) { return object.update(); }); }); });
    }
    const BoxArray array(boxes, "boxes", layout);
    refuse_unreturned();
    warn_of_inverted({&array});
    return changes([&] {
      or_name_row(array, [&] { delta_ = with([&](auto& object) { return object.update(array.view()); }); });
      take_mapped();
    });
  }
  SavedObjects save() {
    const OneThread::Use use(thread_);
    refuse_unreturned();
    return without_gil([&] { return with([](const auto& object) { return SavedObjects{object.save()}; }); });
  }
  nanobind::object restore(const SavedObjects& saved) {
    refuse_unreturned();
    return changes([&] {
      delta_ = without_gil([&] {
        return std::visit([](auto& object, const auto& state) { return restored(object, state); },
                          *broad_phase_, saved.state);
      });
      take_mapped();
    });
  }

  /// What makes an object that goes on from here. (The configuration is without functions, which Python
  /// cannot set.)
  using Pickled = std::tuple<std::string, std::string, std::size_t, bool, double, bool, SavedObjects>;
  [[nodiscard]] Pickled pickled() {
    return {config_.device,   config_.algorithm, config_.threads, config_.profile,
            config_.distance, is_in_double(),    save()};
  }
  /// Of an object that was pickled. The device is selected anew.
  explicit Objects(const Pickled& pickled)
      : Objects(to_config(std::get<0>(pickled), std::get<1>(pickled), std::get<2>(pickled),
                          std::get<3>(pickled), std::get<4>(pickled)),
                std::get<5>(pickled)) {
    (void)restore(std::get<6>(pickled));
  }
  nanobind::object finish() {
    return changes(
        [&] { or_refuse_nan([&] { delta_ = with([](auto& object) { return object.finish(); }); }); });
  }
  void begin(nanobind::handle boxes, const std::string& layout) {
    if (boxes.is_none()) {
      const OneThread::Use use(thread_);
      refuse_unreturned();
      return or_refuse_nan([&] { with([](auto& object) { object.begin(); }); });
    }
    const BoxArray array(boxes, "boxes", layout);
    warn_of_inverted({&array});
    const OneThread::Use use(thread_);
    refuse_unreturned();
    or_name_row(array, [&] { with([&](auto& object) { object.begin(array.view()); }); });
    take_mapped();
  }

  bool contains(nanobind::handle id) {
    const auto integer = nanobind::steal(PyNumber_Index(id.ptr()));
    if (!integer.is_valid()) throw nanobind::python_error();
    std::uint32_t known = 0;
    const OneThread::Use use(thread_);
    return nanobind::try_cast(integer, known) &&
           with([&](const auto& object) { return object.contains(known); });
  }

  nanobind::object box(std::optional<std::uint32_t> id) {
    const std::uint32_t known = required(id, "id");
    const OneThread::Use use(thread_);
    return with([&](const auto& object) { return to_array(object.box(known)); });
  }

  nanobind::dict filter(std::optional<std::uint32_t> id) {
    const std::uint32_t known = required(id, "id");
    const OneThread::Use use(thread_);
    const Filter filter = with([&](const auto& object) { return object.filter(known); });
    return of_fields([&](std::uint32_t Filter::*field) { return nanobind::int_(filter.*field); });
  }

  nanobind::object ids() {
    const OneThread::Use use(thread_);
    return to_array(with([](const auto& object) { return object.ids(); }));
  }

  nanobind::object boxes() {
    const OneThread::Use use(thread_);
    return with([](const auto& object) { return to_array(without_gil([&] { return object.boxes(); })); });
  }

  nanobind::dict filters() {
    const OneThread::Use use(thread_);
    const std::vector<Filter> filters =
        without_gil([&] { return with([](const auto& object) { return object.filters(); }); });
    return of_fields([&](std::uint32_t Filter::*field) {
      std::vector<std::uint32_t> words(filters.size());
      std::ranges::transform(filters, words.begin(), field);
      return to_array(std::move(words));
    });
  }

  nanobind::object reaches() {
    const OneThread::Use use(thread_);
    return with([](const auto& object) { return to_array(object.reaches()); });
  }

  nanobind::object exclusions() {
    const OneThread::Use use(thread_);
    return to_array(with([](const auto& object) { return object.exclusions(); }));
  }

  double reach(std::optional<std::uint32_t> id) {
    const std::uint32_t known = required(id, "id");
    const OneThread::Use use(thread_);
    return with([&](const auto& object) { return static_cast<double>(object.reach(known)); });
  }

  nanobind::object partners(std::optional<std::uint32_t> id) {
    const std::uint32_t known = required(id, "id");
    const OneThread::Query use(thread_);
    return to_array(
        without_gil([&] { return with([&](const auto& object) { return object.partners(known); }); }));
  }

  /// overlapping() or nearest().
  template <Verb verb>
  nanobind::tuple find(nanobind::handle boxes, nanobind::handle group, nanobind::handle mask,
                       nanobind::handle body, nanobind::handle world, std::optional<std::uint32_t> limit,
                       nanobind::handle except, std::uint64_t most_hits, bool count_only,
                       std::optional<double> within, const std::string& layout) {
    const BoxArray array(boxes, "boxes", layout);
    const Query query(group, mask, body, world, limit, except, most_hits, count_only, within,
                      array.view().size());
    return hits_of(array, verb, [&](const auto& object) {
      return verb == Verb::nearest ? object.nearest(array.view(), query.options())
                                   : object.overlapping(array.view(), query.options());
    });
  }

  nanobind::tuple along(nanobind::handle starts, nanobind::handle directions, nanobind::handle lengths,
                        nanobind::handle group, nanobind::handle mask, nanobind::handle body,
                        nanobind::handle world, std::optional<std::uint32_t> limit, nanobind::handle except,
                        std::uint64_t most_hits, bool count_only, const std::string& layout) {
    const BoxArray array(starts, "starts", layout);
    const Query query(group, mask, body, world, limit, except, most_hits, count_only, {},
                      array.view().size());
    const Ways ways = to_ways(directions, lengths, array);
    return hits_of(array, Verb::along, [&]<class Box>(const BasicBroadPhase<Box>& object) {
      using Bound = typename BasicBroadPhase<Box>::Bound;
      std::vector<std::array<Bound, 3>> rounded;
      for (const auto& [x, y, z] : ways.directions)
        rounded.push_back({static_cast<Bound>(x), static_cast<Bound>(y), static_cast<Bound>(z)});
      return object.along(array.view(), rounded, bounds_for(object, ways.lengths), query.options());
    });
  }

  nanobind::object pairs() {
    const OneThread::Use use(thread_);
    return to_array(without_gil([&] { return with([](const auto& object) { return object.pairs(); }); }));
  }

  std::size_t size() {
    const OneThread::Use use(thread_);
    return with([](const auto& object) { return object.size(); });
  }

  std::optional<Device> device() {
    const OneThread::Use use(thread_);
    const Device* device = with([](const auto& object) { return object.device(); });
    return device == nullptr ? std::nullopt : std::optional(*device);
  }

  std::string algorithm() {
    return with([](const auto& object) { return std::string(object.algorithm().name); });
  }

  std::string text() {
    const std::optional<Device> where = device();
    return "<broadcl.BroadPhase " + algorithm() + " on " +
           (where ? where->id() + " " + where->label() : "the host") +
           (is_in_double() ? ", float64" : ", float32") + ", len " + std::to_string(size()) + ">";
  }

  [[nodiscard]] bool is_in_double() const noexcept {
    return std::holds_alternative<BroadPhase64>(*broad_phase_);
  }

  nanobind::dict memory() {
    const OneThread::Use use(thread_);
    return to_dict(with([](const auto& object) { return object.memory(); }));
  }

  nanobind::dict profile() {
    const OneThread::Use use(thread_);
    return with([](const auto& object) { return to_dict(object.profile()); });
  }

 private:
  /// The fields of filters, as callers name them.
  /// @param value_of Called with a pointer to each member.
  template <class Function>
  static nanobind::dict of_fields(const Function& value_of) {
    nanobind::dict result;
    result["group"] = value_of(&Filter::group);
    result["mask"] = value_of(&Filter::mask);
    result["body"] = value_of(&Filter::body);
    result["world"] = value_of(&Filter::world);
    return result;
  }

  /// Numbers as bounds of the boxes of an object.
  template <class Box>
  static std::vector<typename BasicBroadPhase<Box>::Bound> bounds_for(const BasicBroadPhase<Box>& /*object*/,
                                                                      const std::vector<double>& numbers) {
    return {numbers.begin(), numbers.end()};
  }

  /// Ends the writing to the last array of map(), and makes another one.
  template <class Object>
  nanobind::object array_of_map(Object& object, std::size_t n) {
    auto mapped = without_gil([&] { return object.map(n); });
    take_mapped();
    using Bound = std::remove_reference_t<decltype(mapped.front().lower.front())>;
    using Rows = nanobind::ndarray<nanobind::numpy, Bound, nanobind::shape<-1, 6>>;
    auto owner = std::make_unique<std::shared_ptr<const void>>(mapped.owner);
    return Rows(mapped.data(), {n, 6}, keep(std::move(owner))).cast(nanobind::rv_policy::reference);
  }

  /// @param update Does an update and stores its changes.
  template <class Function>
  nanobind::object changes(const Function& update) {
    const OneThread::Use use(thread_);
    if (!delta_) update();
    nanobind::object changes =
        make_delta(to_array(delta_->added, delta_->owner), to_array(delta_->removed, delta_->owner));
    delta_.reset();
    return changes;
  }

  /// @param search Finds the hits of boxes of the caller.
  template <class Search>
  nanobind::tuple hits_of(const BoxArray& boxes, Verb verb, const Search& search) {
    warn_of_inverted({&boxes});
    const OneThread::Query use(thread_);
    Hits hits;
    or_name_row(boxes, [&] { hits = with(search); });
    return to_arrays(std::move(hits), verb);
  }

  void refuse_unreturned() const {
    if (delta_) throw Error("the last update's changes were not returned; call finish() for them first");
  }

  /// Does something with boxes of the caller. The message for a NaN names its row.
  template <class Function>
  static void or_name_row(const BoxArray& boxes, const Function& function) {
    try {
      without_gil(function);
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::invalid_argument) boxes.refuse_nan();
      throw;
    }
  }

  /// Ends the writing to the array of map(): it can only be read from now on.
  void take_mapped() {
    if (!array_.is_valid()) return;
    array_.attr("setflags")(nanobind::arg("write") = false);
    array_.reset();
  }

  /// Does an update, or begins one. A NaN in the array of map() is the caller's error, not the device's,
  /// and can be corrected there: only then is the array still to be written.
  template <class Function>
  void or_refuse_nan(const Function& function) {
    try {
      without_gil(function);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::invalid_argument) take_mapped();
      throw;
    } catch (...) {
      take_mapped();
      throw;
    }
    take_mapped();
  }

  /// @throws Error if the types of their boxes differ.
  template <class Box, class Other>
  static Delta restored(BasicBroadPhase<Box>& object, const BasicState<Other>& state) {
    if constexpr (std::is_same_v<Box, Other>) {
      return object.restore(state);
    } else {
      const std::string dtype = std::is_same_v<Other, Aabb64> ? "float64" : "float32";
      throw Error::invalid_argument("the state is of boxes in " + dtype +
                                    "; restore it in a BroadPhase with this dtype");
    }
  }

  OneThread thread_;
  Config config_;
  std::optional<Either> broad_phase_;
  std::optional<Delta> delta_;  // of the last update, until its arrays are made

  nanobind::object array_;  // of map(), as long as what is written there counts
};

}  // namespace broadcl::python
