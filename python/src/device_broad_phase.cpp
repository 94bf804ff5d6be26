#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/opencl.hpp>

#include "arrays.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "device_array.hpp"
#include "gil.hpp"
#include "keywords.hpp"
#include "one_thread.hpp"
#include "profile.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

/// The changes of an update, in arrays of pyopencl.
struct DeviceChanges {
  nb::object added;
  nb::object removed;
  std::size_t pair_count;
  std::size_t invalid_boxes;
  std::optional<std::uint32_t> first_invalid;
};

/// A DeviceBroadPhase for Python: one thread at a time, with arrays of pyopencl.
class DeviceObjects {
 public:
  DeviceObjects(nb::handle queue, const std::string& algorithm, bool profile)
      : queue_(nb::borrow(queue)),
        broad_phase_(open(queue, algorithm, profile)),
        pool_(make_memory_pool(queue)) {}
  DeviceObjects(const DeviceObjects&) = delete;
  DeviceObjects& operator=(const DeviceObjects&) = delete;
  ~DeviceObjects() = default;

  DeviceChanges update(nb::handle boxes, nb::handle second, nb::handle filters, bool worlds) {
    begin(boxes, second, filters, worlds);
    return finish();
  }

  void begin(nb::handle boxes, nb::handle second, nb::handle filters, bool worlds) {
    const OneThread::Use use(thread_);
    if (result_) throw Error("the last update's changes were not returned; call finish() for them first");
    const Sets sets(queue_, boxes, second, filters, worlds);
    {
      const GilReleased released;
      broad_phase_.begin(sets.boxes);
    }
    inputs_ = nb::make_tuple(boxes, second, filters);
  }

  DeviceChanges finish() {
    const OneThread::Use use(thread_);
    const nb::object inputs = std::exchange(inputs_, nb::none());
    if (!result_) {
      const GilReleased released;
      result_ = broad_phase_.finish();
    }
    DeviceChanges changes{copy_on_device(result_->added, queue_, pool_),
                          copy_on_device(result_->removed, queue_, pool_), result_->pair_count,
                          result_->invalid_boxes, result_->first_invalid};
    result_.reset();
    return changes;
  }

  void set_exclusions(nb::handle pairs) {
    const std::vector<Pair> exclusions = to_exclusions(pairs);
    const OneThread::Use use(thread_);
    const GilReleased released;
    broad_phase_.set_exclusions(exclusions);
  }

  void shrink() {
    const OneThread::Use use(thread_);
    if (result_) throw Error("the last update's changes were not returned; call finish() for them first");
    {
      const GilReleased released;
      broad_phase_.shrink();
    }
    pool_.attr("free_held")();
  }

  nb::object pairs() {
    const OneThread::Use use(thread_);
    DeviceBroadPhase::PairBuffer pairs;
    {
      const GilReleased released;
      pairs = broad_phase_.pairs();
    }
    return copy_on_device(pairs, queue_, pool_);
  }

  nb::object queue() const { return queue_; }
  Device device() const { return broad_phase_.device(); }
  nb::dict memory() {
    const OneThread::Use use(thread_);
    return to_dict(broad_phase_.memory());
  }
  nb::dict profile() {
    const OneThread::Use use(thread_);
    return to_dict(broad_phase_.profile());
  }

  /// See `find_on_device`.
  static nb::object find(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle queue,
                         const std::string& algorithm) {
    const Sets sets(queue, a, b, nb::none(), false);
    const DeviceBroadPhase::Boxes& boxes = sets.boxes;
    std::vector<Pair> without = to_exclusions(exclusions, boxes.count,
                                              b.is_none() ? std::nullopt : std::optional(boxes.second.count));
    if (!b.is_none()) {  // they are counted as if the second set followed the first
      for (Pair& pair : without) pair.b += static_cast<std::uint32_t>(boxes.count);
    }
    const cl_command_queue handle = to_queue(queue);
    DeviceBroadPhase::Result result;
    std::optional<DeviceBroadPhase> broad_phase;
    {
      const GilReleased released;
      broad_phase.emplace(handle, DeviceBroadPhase::Config{.algorithm = algorithm});
      if (!without.empty()) broad_phase->set_exclusions(without);
      result = broad_phase->update(boxes);
    }
    if (result.first_invalid) {
      const bool is_first = *result.first_invalid < boxes.count;
      const std::size_t row = *result.first_invalid - (is_first ? 0 : boxes.count);
      const std::string name = is_first ? (b.is_none() ? "boxes" : "a") : "b";
      throw nb::value_error(("row " + std::to_string(row) + " of " + name + " has a NaN bound; " +
                             "give an empty box (lower > upper) for an object without one")
                                .c_str());
    }
    return show_on_device(result.added, queue);
  }

 private:
  static DeviceBroadPhase open(nb::handle queue, const std::string& algorithm, bool profile) {
    (void)to_config(std::nullopt, algorithm, 0);
    const cl_command_queue handle = to_queue(queue);
    const GilReleased released;
    return DeviceBroadPhase(handle, {.algorithm = algorithm, .profile = profile});
  }

  /// The boxes of an update.
  struct Sets {
    Sets(nb::handle queue, nb::handle first_set, nb::handle second_set, nb::handle filters, bool worlds)
        : first(first_set, queue, second_set.is_none() ? "boxes" : "the first set") {
      boxes = {.buffer = first.buffer,
               .count = first.count,
               .offset = first.offset,
               .stride = first.stride,
               .worlds = worlds};
      if (!second_set.is_none()) {
        const DeviceBoxes& other = second.emplace(second_set, queue, "the second set");
        boxes.second = {
            .buffer = other.buffer, .count = other.count, .offset = other.offset, .stride = other.stride};
      }
      boxes.filters = to_filters(filters, queue, boxes.count + boxes.second.count);
    }

    DeviceBoxes first;
    std::optional<DeviceBoxes> second;
    DeviceBroadPhase::Boxes boxes;
  };

  OneThread thread_;
  nb::object queue_;
  DeviceBroadPhase broad_phase_;
  nb::object pool_;                                 // of the arrays that are returned
  nb::object inputs_ = nb::none();                  // of the update that was begun
  std::optional<DeviceBroadPhase::Result> result_;  // of the last update, until its changes are copied
};

}  // namespace

nb::object find_on_device(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle queue,
                          const std::string& algorithm) {
  (void)to_config(std::nullopt, algorithm, 0);
  const nb::object own = queue_of(a, queue);
  return DeviceObjects::find(a, b, exclusions, own, algorithm);
}

// NOLINTNEXTLINE(readability-function-size): a table
void add_device_broad_phase(nb::module_& module) {
  nb::class_<DeviceChanges>(module, "DeviceDelta",
                            R"(What changed between two updates of a `DeviceBroadPhase`.

``added, removed = device_broad_phase.update(boxes)`` takes it apart. The arrays own their data;
``get()`` copies them to NumPy. When an array is no longer referenced, its memory is used again, by
commands in the queue of the broad phase: keep arrays that another queue reads until it has finished.)")
      .def_ro("added", &DeviceChanges::added, nb::sig("def added(self) -> pyopencl.array.Array"),
              "``(m, 2)`` uint32, on the device: the pairs that began to overlap, in canonical order.")
      .def_ro("removed", &DeviceChanges::removed, nb::sig("def removed(self) -> pyopencl.array.Array"),
              "``(m, 2)`` uint32, on the device: the pairs that ceased to overlap, in canonical order.")
      .def_ro("pair_count", &DeviceChanges::pair_count, "Number of pairs that overlap now.")
      .def_ro("invalid_boxes", &DeviceChanges::invalid_boxes,
              "Number of boxes with a NaN bound. They overlap nothing.")
      .def_ro("first_invalid", &DeviceChanges::first_invalid,
              "The index of the first of these, or None. A second set follows the first.")
      .def(
          "__iter__",
          [](const DeviceChanges& changes) {
            return nb::iter(nb::make_tuple(changes.added, changes.removed));
          },
          nb::sig("def __iter__(self) -> collections.abc.Iterator[pyopencl.array.Array]"))
      .def("__repr__", [](const DeviceChanges& changes) {
        return nb::str("DeviceDelta(added={!r}, removed={!r})").format(changes.added, changes.removed);
      });

  nb::class_<DeviceObjects>(
      module, "DeviceBroadPhase",
      R"(A `BroadPhase` for boxes in pyopencl arrays or buffers: pairs and changes stay on the device, too.

Object k is the box at index k, the same object in every update. Every update tests all boxes. The
GIL is released while the device works.

Parameters
----------
queue : pyopencl.CommandQueue
    In order. All work is done in it, and nothing else may use it during a call.
algorithm : str
    ``"auto"``, ``"brute-force"`` or ``"tiles"``.
profile : bool
    Whether to measure stages on the device; the queue must have profiling enabled.

Raises
------
TypeError
    For another kind of queue.
ValueError
    For an unknown algorithm.
Error
    For an algorithm of the host, an out-of-order queue, and if OpenCL fails.
RuntimeError
    By every method, if another thread is using the object.)")
      .def(
          "__init__",
          with_keywords(
              "DeviceBroadPhase", +[](DeviceObjects* self, nb::handle queue, const std::string& algorithm,
                                      bool profile) { new (self) DeviceObjects(queue, algorithm, profile); }),
          "queue"_a = nb::none(), nb::kw_only(), "algorithm"_a = "auto", "profile"_a = false, "unknown"_a,
          nb::sig("def __init__(self, queue: pyopencl.CommandQueue, *, algorithm: str = 'auto', "
                  "profile: bool = False) -> None"))
      .def(
          "update", with_keywords("update", &DeviceObjects::update), "boxes"_a = nb::none(),
          "second"_a = nb::none(), nb::kw_only(), "filters"_a = nb::none(), "worlds"_a = false, "unknown"_a,
          nb::sig("def update(self, boxes: pyopencl.array.Array | pyopencl.Buffer, second: "
                  "pyopencl.array.Array | pyopencl.Buffer | None = None, *, filters: pyopencl.array.Array | "
                  "pyopencl.Buffer | None = None, worlds: bool = False) -> DeviceDelta"),
          R"(Finds every overlapping pair that the filters allow, and returns what changed since the last update;
objects beyond the last box no longer exist.

Waits for the queue once, for the counts. A call that raises leaves the known pairs as they were;
but see `finish` for exceptions of pyopencl.

Parameters
----------
boxes : pyopencl.array.Array or pyopencl.Buffer
    float32, ``(n, 6)`` or ``(n, 2, 3)``, the numbers of each box without gaps; or a buffer of such
    boxes. Only read. A box with a NaN overlaps nothing, and is counted.
second : pyopencl.array.Array or pyopencl.Buffer, optional
    A second set. Then only pairs of a box of the first set and a box of the second are found. The
    first set must have the same number of boxes in every update.
filters : pyopencl.array.Array or pyopencl.Buffer, optional
    ``(n, 4)`` uint32: group, mask, body and world of each box, those of a second set after the
    first.
worlds : bool
    Whether the filters have different worlds. It affects only speed.

Returns
-------
DeviceDelta
    ``added`` and ``removed``, pairs of indices, and counts.

Raises
------
TypeError
    For arrays that are not on the device, or not float32.
ValueError
    For a wrong shape or another queue.
Error
    If the device fails, and between `begin` and `finish`.)")
      .def("begin", with_keywords("begin", &DeviceObjects::begin), "boxes"_a = nb::none(),
           "second"_a = nb::none(), nb::kw_only(), "filters"_a = nb::none(), "worlds"_a = false, "unknown"_a,
           nb::sig("def begin(self, boxes: pyopencl.array.Array | pyopencl.Buffer, second: "
                   "pyopencl.array.Array | pyopencl.Buffer | None = None, *, filters: pyopencl.array.Array | "
                   "pyopencl.Buffer | None = None, worlds: bool = False) -> None"),
           R"(Enqueues an update, and returns at once.

The arguments are those of `update`. They are referenced until `finish`.

Raises
------
TypeError, ValueError, Error
    As `update` does.)")
      .def("finish", with_keywords("finish", &DeviceObjects::finish),
           nb::sig("def finish(self) -> DeviceDelta"),
           R"(Waits for the update that `begin` started, and returns the changes.

If pyopencl fails while it copies the changes, call `finish` again; no other update can begin before.

Returns
-------
DeviceDelta
    The changes.

Raises
------
Error
    As `update` does, and if no update was begun.)")
      .def("set_exclusions", with_keywords("set_exclusions", &DeviceObjects::set_exclusions),
           "pairs"_a = nb::none(), "unknown"_a,
           nb::sig("def set_exclusions(self, pairs: numpy.typing.ArrayLike) -> None"),
           R"(Replaces the list of pairs of indices that are never reported.

Initially it is empty. Waits for the queue.

Parameters
----------
pairs : array_like of int
    ``(m, 2)``, in host memory, in any order; copied. For these indices, a second set follows the
    first.

Raises
------
ValueError
    For a pair of an index and itself, and for a wrong shape.
TypeError
    For another dtype.
Error
    Between `begin` and `finish`.)")
      .def("shrink", with_keywords("shrink", &DeviceObjects::shrink), nb::sig("def shrink(self) -> None"),
           R"(Gives back memory that the boxes and pairs of the last update do not need.

Nothing does so by itself; call it after an update with far more pairs than usual. Arrays that were
returned stay valid. Waits for the queue.

Raises
------
Error
    Between `begin` and `finish`, and if the device fails.)")
      .def("pairs", with_keywords("pairs", &DeviceObjects::pairs),
           nb::sig("def pairs(self) -> pyopencl.array.Array"),
           R"(Returns all pairs as of the last update.

Returns
-------
pyopencl.array.Array
    ``(m, 2)`` uint32, on the device, owned by the caller, in canonical order: sorted by b, then by
    a; for one set, a < b.

Raises
------
Error
    Between `begin` and `finish`.)")
      .def("profile", with_keywords("profile", &DeviceObjects::profile),
           nb::sig("def profile(self) -> dict[str, dict[str, float]]"),
           R"(Returns where the time of the last update went.

Returns
-------
dict of str to dict
    The stages, as in `BroadPhase.profile`.)")
      .def_prop_ro("queue", &DeviceObjects::queue, nb::sig("def queue(self) -> pyopencl.CommandQueue"),
                   "The pyopencl.CommandQueue in which all work is done.")
      .def_prop_ro("device", &DeviceObjects::device, "The `Device` of the queue.")
      .def_prop_ro(
          "memory", &DeviceObjects::memory, nb::sig("def memory(self) -> dict[str, int]"),
          "OpenCL memory of this object, bytes, without the caller's arrays; as in `BroadPhase.memory`.");
}

}  // namespace broadcl::python
