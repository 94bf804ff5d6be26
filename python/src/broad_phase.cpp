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
#include <utility>
#include <vector>

#include <broadcl/broad_phase.hpp>

#include "arrays.hpp"
#include "box_array.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "gil.hpp"
#include "one_thread.hpp"
#include "profile.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

template <class Function>
auto without_gil(const Function& function) {
  const GilReleased released;
  return function();
}

/// The changes of an update as arrays.
struct Changes {
  nb::object added;
  nb::object removed;
};

/// One value or array per field of a Filter.
class Filters {
 public:
  Filters(nb::handle group, nb::handle mask, nb::handle body, nb::handle world, std::size_t n)
      : words_{Words(group, "group", {.is_bits = true}), Words(mask, "mask", {.is_bits = true}),
               Words(body, "body", {.remedy = "; broadcl.NO_BODY belongs to none"}),
               Words(world, "world", {.remedy = "; broadcl.ALL_WORLDS is all of them"})} {
    for (const Words& words : words_) {
      if (words.is_single() || words.size() == n) continue;
      throw nb::value_error(("filters must be integers, or arrays of length " + std::to_string(n) + ", not " +
                             std::to_string(words.size()))
                                .c_str());
    }
  }

  Filter operator[](std::size_t k) const {
    return {.group = words_[0][k], .mask = words_[1][k], .body = words_[2][k], .world = words_[3][k]};
  }

 private:
  std::array<Words, 4> words_;
};

/// A BroadPhase for Python: one thread at a time, all or nothing for arrays too, and arrays that live as long
/// as anybody looks at them.
class Objects {
 public:
  explicit Objects(const Config& config) : broad_phase_(without_gil([&] { return BroadPhase(config); })) {}
  Objects(const Objects&) = delete;
  Objects& operator=(const Objects&) = delete;
  /// May wait for the thread that opens a device.
  ~Objects() {
    const GilReleased released;
    const std::optional<BroadPhase> last = std::move(broad_phase_);
  }

  nb::object add(nb::handle boxes, nb::handle group, nb::handle mask, nb::handle body, nb::handle world) {
    const BoxArray array(boxes, "boxes");
    refuse_too_many(array.view().size());
    array.refuse_nan();
    const Filters filters(group, mask, body, world, array.view().size());
    const OneThread::Use use(thread_);
    take_mapped();
    std::vector<std::uint32_t> ids;
    ids.reserve(array.view().size());
    const std::size_t size = broad_phase_->size() + array.view().size();  // ids are dense
    if (size > live_.capacity()) live_.reserve(std::max(size, 2 * live_.capacity()));
    nb::object result;
    try {
      for (std::size_t k = 0; k < array.view().size(); ++k) {
        ids.push_back(broad_phase_->add(array.view()[k], filters[k]));
      }
      result = array.is_single() ? nb::int_(ids.front()) : to_array(std::vector(ids));
    } catch (...) {
      for (const std::uint32_t id : ids) broad_phase_->remove(id);
      throw;
    }
    for (const std::uint32_t id : ids) set_live(id, true);
    return result;
  }

  void move(nb::handle ids, nb::handle boxes) {
    const Words words(ids, "ids");
    const BoxArray array(boxes, "boxes");
    if (words.is_single() != array.is_single() && words.size() == array.view().size()) {
      throw nb::value_error(
          "move() needs one id and one box, or arrays of both; not one and an array of one");
    }
    if (words.size() != array.view().size()) {
      throw nb::value_error(("move() needs one id and one box, or as many ids as boxes; not " +
                             std::to_string(words.size()) + " and " + std::to_string(array.view().size()))
                                .c_str());
    }
    array.refuse_nan();
    const OneThread::Use use(thread_);
    refuse_unknown(words);
    take_mapped();
    for (std::size_t k = 0; k < words.size(); ++k) broad_phase_->move(words[k], array.view()[k]);
  }

  void set_filter(nb::handle ids, nb::handle group, nb::handle mask, nb::handle body, nb::handle world) {
    const Words words(ids, "ids");
    const Filters filters(group, mask, body, world, words.size());
    const OneThread::Use use(thread_);
    refuse_unknown(words);
    take_mapped();
    for (std::size_t k = 0; k < words.size(); ++k) broad_phase_->set_filter(words[k], filters[k]);
  }

  void remove(nb::handle ids) {
    const Words words(ids, "ids");
    const OneThread::Use use(thread_);
    refuse_unknown(words);
    std::vector<std::uint32_t> sorted;
    for (std::size_t k = 0; k < words.size(); ++k) sorted.push_back(words[k]);
    std::ranges::sort(sorted);
    const auto twice = std::ranges::adjacent_find(sorted);
    if (twice != sorted.end()) {
      throw nb::value_error(("id " + std::to_string(*twice) + " is given twice; name each once").c_str());
    }
    take_mapped();
    for (std::size_t k = 0; k < words.size(); ++k) {
      broad_phase_->remove(words[k]);
      set_live(words[k], false);
    }
  }

  void set_exclusions(nb::handle pairs) {
    const std::vector<Pair> exclusions = to_exclusions(pairs);
    const OneThread::Use use(thread_);
    take_mapped();
    const GilReleased released;
    broad_phase_->set_exclusions(exclusions);
  }

  void shrink() {
    const OneThread::Use use(thread_);
    if (delta_) throw Error("the last update's changes were not returned; call finish() for them first");
    take_mapped();
    const GilReleased released;
    broad_phase_->shrink();
    live_.shrink_to_fit();
  }

  nb::object boxes(std::size_t n) {
    refuse_too_many(n);
    const OneThread::Use use(thread_);
    std::span<Aabb> mapped;
    const std::shared_ptr<const void> before = broad_phase_->mapped_memory();
    try {
      const GilReleased released;
      live_.reserve(n);
      mapped = broad_phase_->map(n);
      live_.assign(n, 1);
    } catch (...) {  // `auto` leaves a device that failed, and its memory
      if (broad_phase_->mapped_memory() != before) take_mapped();
      throw;
    }
    take_mapped();
    using Array = nb::ndarray<nb::numpy, float, nb::shape<-1, 6>>;
    array_ = Array(mapped.data(), {n, 6},
                   keep(std::make_unique<std::shared_ptr<const void>>(broad_phase_->mapped_memory())))
                 .cast(nb::rv_policy::reference);
    return array_;
  }

  Changes update() {
    return changes([&] { return broad_phase_->update(); });
  }
  Changes finish() {
    return changes([&] { return broad_phase_->finish(); });
  }
  void begin() {
    const OneThread::Use use(thread_);
    if (delta_) throw Error("the last update's changes were not returned; call finish() for them first");
    or_refuse_nan([&] {
      const GilReleased released;
      broad_phase_->begin();
    });
  }

  nb::object pairs() {
    const OneThread::Use use(thread_);
    return to_array(without_gil([&] { return broad_phase_->pairs(); }));
  }

  std::size_t size() {
    const OneThread::Use use(thread_);
    return broad_phase_->size();
  }

  std::optional<Device> device() {
    const OneThread::Use use(thread_);
    const Device* device = broad_phase_->device();
    return device == nullptr ? std::nullopt : std::optional(*device);
  }

  std::string algorithm() { return std::string(broad_phase_->algorithm().name); }

  nb::dict memory() {
    const OneThread::Use use(thread_);
    return to_dict(broad_phase_->memory());
  }

  nb::dict profile() {
    const OneThread::Use use(thread_);
    return to_dict(broad_phase_->profile());
  }

 private:
  template <class Function>
  Changes changes(const Function& function) {
    const OneThread::Use use(thread_);
    if (!delta_) {
      or_refuse_nan([&] {
        const GilReleased released;
        delta_ = function();
      });
    }
    const std::shared_ptr<const void> memory = broad_phase_->delta_memory();
    Changes changes{to_array(delta_->added, memory), to_array(delta_->removed, memory)};
    delta_.reset();
    return changes;
  }

  /// Ends the writing to the array of boxes(): it can only be read from now on.
  void take_mapped() {
    if (!array_.is_valid()) return;
    array_.attr("setflags")("write"_a = false);
    array_.reset();
  }

  /// Does an update, or begins one. A NaN in the array of boxes() is the caller's error, not the device's,
  /// and can be corrected there: only then is the array still to be written.
  template <class Function>
  void or_refuse_nan(const Function& function) {
    try {
      function();
    } catch (const std::exception& error) {
      if (is_of_nan(error)) throw nb::value_error(error.what());
      take_mapped();
      throw;
    }
    take_mapped();
  }

  static void refuse_too_many(std::size_t boxes) {
    constexpr std::size_t most = std::size_t{1} << 31;
    if (boxes <= most) return;
    throw nb::value_error(
        (std::to_string(boxes) + " boxes are too many; use at most " + std::to_string(most)).c_str());
  }

  void refuse_unknown(const Words& ids) const {
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (ids[k] < live_.size() && live_[ids[k]] != 0) continue;
      throw nb::value_error(
          ("no object has the id " + std::to_string(ids[k]) + "; use the ids that add() returned").c_str());
    }
  }

  void set_live(std::uint32_t id, bool is_live) {
    if (id >= live_.size()) live_.resize(id + 1, 0);
    live_[id] = is_live ? 1 : 0;
  }

  OneThread thread_;
  std::optional<BroadPhase> broad_phase_;
  std::vector<std::uint8_t> live_;  // by id
  std::optional<Delta> delta_;      // of the last update, until its arrays are made

  nb::object array_;  // of boxes(), as long as what is written there counts
};

}  // namespace

// NOLINTNEXTLINE(readability-function-size): a table
void add_broad_phase(nb::module_& module) {
  nb::class_<Changes>(
      module, "Delta",
      "What changed between two updates: ``added, removed = broad_phase.update()``.\n\n"
      "Apply ``removed`` first: if an object was removed and a new one got its id in between, the\n"
      "same pair of ids may be in both. You may keep the arrays for as long as you like. Up to\n"
      "2,048 pairs are a copy; a longer array is a view of the core's memory, which is not reused\n"
      "as long as the array exists, and may be several times as large, so copy the arrays if you\n"
      "keep those of many updates.")
      .def_ro("added", &Changes::added, nb::sig("def added(self) -> numpy.typing.NDArray[numpy.uint32]"),
              "(m, 2) uint32: pairs that began to overlap, in canonical order.")
      .def_ro("removed", &Changes::removed,
              nb::sig("def removed(self) -> numpy.typing.NDArray[numpy.uint32]"),
              "(m, 2) uint32: pairs that ceased to overlap, in canonical order.")
      .def(
          "__iter__",
          [](const Changes& changes) { return nb::iter(nb::make_tuple(changes.added, changes.removed)); },
          nb::sig("def __iter__(self) -> collections.abc.Iterator[numpy.typing.NDArray[numpy.uint32]]"))
      .def("__repr__", [](const Changes& changes) {
        return nb::str("Delta(added={!r}, removed={!r})").format(changes.added, changes.removed);
      });

  nb::class_<Objects>(
      module, "BroadPhase",
      "Holds a set of moving boxes and reports at each update() which pairs began and which ceased\n"
      "to overlap.\n\n"
      "The cost of an update depends on how much moved. A call that raises has changed nothing, except that "
      "a\n"
      "call with an array of ids may be done in part if memory runs out.\n\n"
      "device: as for select_device(); with None, `algorithm` decides.\n"
      "algorithm: a key of algorithms(). \"auto\" works on the host or on a GPU, whichever is\n"
      "expected to be faster.\n"
      "threads: number of threads that an algorithm of the host may use; 0 for one per processor.\n"
      "profile: whether to measure stages on the device, too.\n\n"
      "Only one thread at a time may use an object; a second one gets a RuntimeError. The GIL is\n"
      "released during searches.\n\n"
      "Raises ValueError for an unknown algorithm, Error for an unknown device, unless the\n"
      "algorithm is one of the host, and if OpenCL fails.")
      .def(
          "__init__",
          [](Objects* self, const Selector& device, const std::string& algorithm, std::size_t threads,
             bool profile) { new (self) Objects(to_config(device, algorithm, threads, profile)); },
          nb::kw_only(), "device"_a = nb::none(), "algorithm"_a = "auto", "threads"_a = 0,
          "profile"_a = false)
      .def(
          "add", &Objects::add, "boxes"_a.none(), nb::kw_only(), "group"_a = 1, "mask"_a = 0xffffffffU,
          "body"_a = Filter::no_body, "world"_a = 0,
          nb::sig(
              "def add(self, boxes: numpy.typing.ArrayLike | tuple[numpy.typing.ArrayLike, "
              "numpy.typing.ArrayLike], *, group: numpy.typing.ArrayLike = 1, mask: numpy.typing.ArrayLike = "
              "4294967295, body: numpy.typing.ArrayLike = 4294967295, world: numpy.typing.ArrayLike = 0) -> "
              "int | numpy.typing.NDArray[numpy.uint32]"),
          "Adds objects and returns their ids: an int for one box, otherwise (n,) uint32. Each is the\n"
          "lowest free id, so ids depend only on the sequence of calls.\n\n"
          "boxes: float32 or float64, in the forms that overlapping_pairs() accepts; one box without\n"
          "the first dimension. float64 is rounded outward.\n"
          "group, mask, body, world: the filter, integers or arrays (n,). Two objects pair if each is\n"
          "in a group of the other's mask, if they are in the same world or one is in ALL_WORLDS, and\n"
          "if they are not of the same body. Of group and mask, -1 is all bits, ~1 all but the lowest.\n\n"
          "Raises ValueError for a NaN (it names the row) and for a wrong shape, TypeError for another\n"
          "dtype.")
      .def("move", &Objects::move, "ids"_a.none(), "boxes"_a.none(),
           nb::sig("def move(self, ids: numpy.typing.ArrayLike, boxes: numpy.typing.ArrayLike | "
                   "tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike]) -> None"),
           "Replaces the box of one object, or of n objects: ids (n,), boxes as for add(). A box that is\n"
           "equal to the old one does not count as movement.\n\n"
           "Raises ValueError for an unknown id, a NaN or a wrong shape; TypeError. Then no object has\n"
           "moved.")
      .def(
          "set_filter", &Objects::set_filter, "ids"_a.none(), nb::kw_only(), "group"_a = 1,
          "mask"_a = 0xffffffffU, "body"_a = Filter::no_body, "world"_a = 0,
          nb::sig(
              "def set_filter(self, ids: numpy.typing.ArrayLike, *, group: numpy.typing.ArrayLike = 1, mask: "
              "numpy.typing.ArrayLike = 4294967295, body: numpy.typing.ArrayLike = 4294967295, world: "
              "numpy.typing.ArrayLike = 0) -> None"),
          "Replaces the whole filter of one object, or of n objects: ids (n,), the rest as for add().\n\n"
          "Raises ValueError for an unknown id; TypeError.")
      .def("set_exclusions", &Objects::set_exclusions, "pairs"_a.none(),
           nb::sig("def set_exclusions(self, pairs: numpy.typing.ArrayLike) -> None"),
           "Replaces the list of pairs of ids that are never reported: (m, 2) integers, in any order.\n"
           "Initially it is empty. pairs_that_share() makes such a list for a mesh.\n\n"
           "Raises ValueError for a pair of an id with itself, and for a wrong shape; TypeError.")
      .def("remove", &Objects::remove, "ids"_a.none(),
           nb::sig("def remove(self, ids: numpy.typing.ArrayLike) -> None"),
           "Removes one object, or n objects: ids (n,). Their pairs are in `removed` of the next update;\n"
           "their ids may be given to the next objects added.\n\n"
           "Raises ValueError for an unknown id, or for one that is given twice.")
      .def("shrink", &Objects::shrink,
           "Gives back memory that the present objects and pairs do not need, on host and device, for\n"
           "instance after an update with far more pairs than usual; nothing does so by itself. Arrays\n"
           "that were returned stay valid, and keep their memory. Waits for the device.\n\n"
           "Raises Error between begin() and finish(), and if the device fails; MemoryError.")
      .def("boxes", &Objects::boxes, "n"_a,
           nb::sig("def boxes(self, n: int) -> numpy.typing.NDArray[numpy.float32]"),
           "Makes 0 .. n-1 the ids of the objects, and returns their boxes for you to write: (n, 6)\n"
           "float32, lower x, y, z, upper x, y, z. New objects have empty boxes. All objects count as\n"
           "moved.\n\n"
           "The array is the memory that the device, or an algorithm of the host, reads. The next call\n"
           "that changes or updates anything takes the boxes and makes the array read-only; call boxes()\n"
           "again for the next frame. (Slices that were made from it before must not be written\n"
           "afterwards, either.) The array keeps its memory alive, so you may keep it. A NaN is a\n"
           "ValueError of the next update(), which names the first row; correct it and call update()\n"
           "again.\n\n"
           "Raises Error between begin() and finish().")
      .def("update", &Objects::update,
           "Finds every pair of overlapping boxes whose filters allow it, and returns what changed since\n"
           "the last update, as a Delta. Releases the GIL.\n\n"
           "Raises Error if the device fails, ValueError for a NaN written to boxes(), MemoryError. The\n"
           "call may be repeated; if there was no memory for the arrays of the Delta, it then returns that\n"
           "Delta, without another search.")
      .def("begin", &Objects::begin,
           "Starts an update on the device and returns at once. Objects that are added, moved or removed\n"
           "before finish() belong to the next update. Raises as update() does.")
      .def("finish", &Objects::finish,
           "Waits for the update that begin() started, or does one, and returns the changes. Releases\n"
           "the GIL.\n"
           "Raises as update() does.")
      .def("pairs", &Objects::pairs, nb::sig("def pairs(self) -> numpy.typing.NDArray[numpy.uint32]"),
           "All pairs as of the last update: (m, 2) uint32, a < b, in canonical order, that is, sorted\n"
           "by b, then by a.\n"
           "Raises Error between begin() and finish().")
      .def("profile", &Objects::profile, nb::sig("def profile(self) -> dict[str, dict[str, float]]"),
           "The stages of the last update: for each name, host_seconds, the seconds that the calling\n"
           "thread spent, and device_seconds, those of the device if profile=True. Empty on the host.")
      .def_prop_ro("device", &Objects::device, "The device that will do the next update; None for the host.")
      .def_prop_ro("algorithm", &Objects::algorithm, "The name of the algorithm.")
      .def_prop_ro(
          "memory", &Objects::memory, nb::sig("def memory(self) -> dict[str, int]"),
          "OpenCL memory in bytes: device, on the device now; device_peak, the largest value of device\n"
          "so far; pinned, pinned host memory.")
      .def("__len__", &Objects::size, "Number of objects.");
}

}  // namespace broadcl::python
