#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/opencl.hpp>

#include "arrays.hpp"
#include "classes.hpp"
#include "config.hpp"
#include "device_arrays.hpp"
#include "gil.hpp"
#include "keywords.hpp"
#include "one_thread.hpp"
#include "profile.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

/// The changes of an update, in arrays on the device.
struct DeviceChanges {
  nb::object added;
  nb::object removed;
  std::size_t pair_count;
  std::size_t invalid_boxes;
  std::optional<std::uint32_t> first_invalid;
};

/// A DeviceBroadPhase for Python: one thread at a time, with arrays on the device.
class DeviceObjects {
 public:
  DeviceObjects(nb::handle device, const std::string& algorithm, bool profile)
      : arrays_(open(device, algorithm, profile)), broad_phase_(open(*arrays_, algorithm, profile)) {}
  DeviceObjects(const DeviceObjects&) = delete;
  DeviceObjects& operator=(const DeviceObjects&) = delete;
  ~DeviceObjects() = default;

  DeviceChanges update(nb::handle boxes, nb::handle second, nb::handle filters, bool worlds) {
    begin(boxes, second, filters, worlds);
    return finish();
  }

  void begin(nb::handle boxes, nb::handle second, nb::handle filters, bool worlds) {
    const OneThread::Use use(thread_);
    refuse_result();
    if (!inputs_.is_none()) {
      throw Error("begin() was called between begin() and finish(); call finish() first");
    }
    DeviceBroadPhase::Boxes read = arrays_->read(boxes, second, filters);
    read.worlds = worlds;
    or_abandon([&] { without_gil([&] { broad_phase_.begin(read); }); });
    inputs_ = nb::make_tuple(boxes, second, filters);
  }

  DeviceChanges finish() {
    const OneThread::Use use(thread_);
    const nb::object inputs = std::exchange(inputs_, nb::none());
    return or_abandon([&] {
      if (!result_) result_ = without_gil([&] { return broad_phase_.finish(); });
      DeviceChanges changes{arrays_->copy(result_->added), arrays_->copy(result_->removed),
                            result_->pair_count, result_->invalid_boxes, result_->first_invalid};
      arrays_->complete();
      result_.reset();
      return changes;
    });
  }

  nb::object boxes(std::size_t n) {
    const OneThread::Use use(thread_);
    return arrays_->make_boxes(n);
  }

  void set_exclusions(nb::handle pairs) {
    const std::vector<Pair> exclusions = to_exclusions(pairs);
    const OneThread::Use use(thread_);
    const GilReleased released;
    broad_phase_.set_exclusions(exclusions);
  }

  void shrink() {
    const OneThread::Use use(thread_);
    refuse_result();
    {
      const GilReleased released;
      broad_phase_.shrink();
    }
    arrays_->shrink();
  }

  nb::object pairs() {
    const OneThread::Use use(thread_);
    const DeviceBroadPhase::PairBuffer pairs = without_gil([&] { return broad_phase_.pairs(); });
    return or_abandon([&] {
      nb::object copy = arrays_->copy(pairs);
      arrays_->complete();
      return copy;
    });
  }

  std::string text() const {
    return "<broadcl.DeviceBroadPhase on " + device().id() + " " + device().label() + ">";
  }
  nb::object queue() const { return arrays_->callers_queue(); }
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
  static nb::object find(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle device,
                         const std::string& algorithm) {
    (void)to_config(std::nullopt, algorithm, 0);
    const DeviceArraysPointer arrays = device_arrays_of(a, device);
    const DeviceBroadPhase::Boxes boxes = arrays->read(a, b, nb::none());
    std::vector<Pair> without = to_exclusions(exclusions, boxes.count,
                                              b.is_none() ? std::nullopt : std::optional(boxes.second.count));
    if (!b.is_none()) {  // they are counted as if the second set followed the first
      for (Pair& pair : without) pair.b += static_cast<std::uint32_t>(boxes.count);
    }
    DeviceBroadPhase::Result result;
    DeviceBroadPhase broad_phase = open(*arrays, algorithm, false);
    {
      const GilReleased released;
      if (!without.empty()) broad_phase.set_exclusions(without);
      result = broad_phase.update(boxes);
    }
    if (result.first_invalid) {
      const bool is_first = *result.first_invalid < boxes.count;
      const std::size_t row = *result.first_invalid - (is_first ? 0 : boxes.count);
      const std::string name = is_first ? (b.is_none() ? "boxes" : "a") : "b";
      throw nb::value_error(("row " + std::to_string(row) + " of " + name + " has a NaN bound; " +
                             "give an empty box (lower > upper) for an object without one")
                                .c_str());
    }
    return arrays->show(result.added);
  }

 private:
  static DeviceArraysPointer open(nb::handle device, const std::string& algorithm, bool profile) {
    (void)to_config(std::nullopt, algorithm, 0);
    return device_arrays(device, profile);
  }

  static DeviceBroadPhase open(const DeviceArrays& arrays, const std::string& algorithm, bool profile) {
    const cl_command_queue queue = arrays.queue();
    const GilReleased released;
    return DeviceBroadPhase(queue, {.algorithm = algorithm, .profile = profile});
  }

  template <class Function>
  static std::invoke_result_t<Function> without_gil(const Function& function) {
    const GilReleased released;
    return function();
  }

  /// Does a part of an update.
  template <class Function>
  std::invoke_result_t<Function> or_abandon(const Function& function) {
    try {
      return function();
    } catch (...) {
      arrays_->abandon();
      throw;
    }
  }

  void refuse_result() const {
    if (result_) throw Error("the last update's changes were not returned; call finish() for them first");
  }

  OneThread thread_;
  DeviceArraysPointer arrays_;
  DeviceBroadPhase broad_phase_;
  nb::object inputs_ = nb::none();                  // of the update that was begun
  std::optional<DeviceBroadPhase::Result> result_;  // of the last update, until its changes are copied
};

}  // namespace

nb::object find_on_device(nb::handle a, nb::handle b, nb::handle exclusions, nb::handle device,
                          const std::string& algorithm) {
  return DeviceObjects::find(a, b, exclusions, device, algorithm);
}

// NOLINTNEXTLINE(readability-function-size): a table
void add_device_broad_phase(nb::module_& module) {
  nb::class_<DeviceChanges>(module, "DeviceDelta",
                            R"(What changed between two updates of a `DeviceBroadPhase`.

``added, removed = device_broad_phase.update(boxes)`` takes it apart. The arrays own their data;
``get()`` copies them to NumPy. When an array is no longer referenced, its memory is used again, by
commands in the queue of the broad phase: keep arrays that another queue or stream reads until it has
finished.)")
      .def_ro("added", &DeviceChanges::added,
              nb::sig("def added(self) -> pyopencl.array.Array | DeviceArray"),
              "``(m, 2)``, on the device, int32 in a `DeviceArray`, otherwise uint32: the pairs that began "
              "to overlap, in canonical order.")
      .def_ro("removed", &DeviceChanges::removed,
              nb::sig("def removed(self) -> pyopencl.array.Array | DeviceArray"),
              "``(m, 2)``, on the device, int32 in a `DeviceArray`, otherwise uint32: the pairs that ceased "
              "to overlap, in canonical order.")
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
          nb::sig("def __iter__(self) -> collections.abc.Iterator[pyopencl.array.Array | DeviceArray]"))
      .def("__repr__", [](const DeviceChanges& changes) {
        return nb::str("DeviceDelta(added={!r}, removed={!r})").format(changes.added, changes.removed);
      });

  nb::class_<DeviceObjects>(
      module, "DeviceBroadPhase",
      R"(A `BroadPhase` for boxes on a device, in tensors of CUDA or arrays of pyopencl: pairs and changes stay there.

Object k is the box at index k, the same object in every update. Every update tests all boxes. The
GIL is released while the device works.

Tensors are those of PyTorch, JAX, CuPy, Warp and every other library with DLPack or the CUDA array
interface. They are copied on the device to memory that CUDA and OpenCL share, but those in the memory
of `boxes` are not. OpenCL begins when their stream has completed what it was given.

Parameters
----------
device : pyopencl.CommandQueue, or a CUDA device
    A queue, in order, in which all work is done; nothing else may use it during a call. Or a device:
    ``"cuda"`` (the current one), ``"cuda:1"``, that of a library, or a tensor there.
algorithm : str
    ``"auto"``, ``"brute-force"`` or ``"tiles"``.
profile : bool
    Whether to measure stages on the device; a queue must have profiling enabled.

Raises
------
TypeError
    For another kind of device.
ValueError
    For an unknown algorithm.
Error
    For an algorithm of the host, an out-of-order queue, if OpenCL or CUDA fails, and if OpenCL has no
    driver that can share the memory of the CUDA device.
RuntimeError
    By every method, if another thread is using the object.

Examples
--------
>>> import pyopencl.array
>>> queue = pyopencl.CommandQueue(pyopencl.create_some_context(interactive=False))
>>> boxes = np.array([[0, 0, 0, 2, 2, 2], [1, 1, 1, 3, 3, 3]], np.float32)
>>> broad_phase = broadcl.DeviceBroadPhase(queue)
>>> added, removed = broad_phase.update(pyopencl.array.to_device(queue, boxes))
>>> added.get().tolist()
[[0, 1]])")
      .def("__init__",
           with_keywords(
               "DeviceBroadPhase",
               +[](DeviceObjects* self, nb::handle device, const std::string& algorithm, bool profile) {
                 new (self) DeviceObjects(device, algorithm, profile);
               }),
           "device"_a = nb::none(), nb::kw_only(), "algorithm"_a = "auto", "profile"_a = false, "unknown"_a,
           nb::sig("def __init__(self, device: object, *, algorithm: str = 'auto', "
                   "profile: bool = False) -> None"))
      .def(
          "update", with_keywords("update", &DeviceObjects::update), "boxes"_a = nb::none(),
          "second"_a = nb::none(), nb::kw_only(), "filters"_a = nb::none(), "worlds"_a = false, "unknown"_a,
          nb::sig("def update(self, boxes: object, second: object | None = None, *, filters: object | None = "
                  "None, worlds: bool = False) -> DeviceDelta"),
          R"(Finds every overlapping pair that the filters allow, and returns what changed since the last update;
objects beyond the last box no longer exist.

Waits for the queue once, for the counts. A call that raises leaves the known pairs as they were;
but see `finish` for changes that cannot be copied.

Parameters
----------
boxes : tensor, pyopencl.array.Array or pyopencl.Buffer
    float32, ``(n, 6)`` or ``(n, 2, 3)``, the numbers of each box without gaps; or a buffer of such
    boxes. Only read. A box with a NaN overlaps nothing, and is counted. A tensor may be overwritten
    when this has returned.
second : tensor, pyopencl.array.Array or pyopencl.Buffer, optional
    A second set. Then only pairs of a box of the first set and a box of the second are found. The
    first set must have the same number of boxes in every update.
filters : tensor, pyopencl.array.Array or pyopencl.Buffer, optional
    ``(n, 4)`` uint32 (of a tensor also int32, in which -1 has all bits): group, mask, body and world of
    each box, those of a second set after the first.
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
    For a wrong shape, and for another queue or CUDA device.
Error
    If the device fails, and between `begin` and `finish`.)")
      .def("begin", with_keywords("begin", &DeviceObjects::begin), "boxes"_a = nb::none(),
           "second"_a = nb::none(), nb::kw_only(), "filters"_a = nb::none(), "worlds"_a = false, "unknown"_a,
           nb::sig("def begin(self, boxes: object, second: object | None = None, *, filters: object | None = "
                   "None, worlds: bool = False) -> None"),
           R"(Enqueues an update, and returns at once.

The arguments are those of `update`. They are referenced until `finish`.

Raises
------
TypeError, ValueError, Error
    As `update` does.)")
      .def("finish", with_keywords("finish", &DeviceObjects::finish),
           nb::sig("def finish(self) -> DeviceDelta"),
           R"(Waits for the update that `begin` started, and returns the changes.

If this fails while it copies the changes, call `finish` again; no other update can begin before.

Returns
-------
DeviceDelta
    The changes.

Raises
------
Error
    As `update` does, and if no update was begun.)")
      .def("boxes", with_keywords("boxes", &DeviceObjects::boxes), "n"_a = 0, "unknown"_a,
           nb::sig("def boxes(self, n: int) -> DeviceArray"),
           R"(Makes memory for boxes that OpenCL reads where they are, without a copy.

Write boxes there in place, ``tensor = torch.from_dlpack(broad_phase.boxes(n))``, and give the tensor, or
a part of it, to `update`. Do not write there between `begin` and `finish`.

Parameters
----------
n : int
    Number of boxes.

Returns
-------
DeviceArray
    ``(n, 6)`` float32, not initialised.

Raises
------
TypeError
    For an object with a queue of pyopencl, whose arrays are never copied.
Error
    If memory runs out.)")
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
           nb::sig("def pairs(self) -> pyopencl.array.Array | DeviceArray"),
           R"(Returns all pairs as of the last update.

Returns
-------
DeviceArray or pyopencl.array.Array
    ``(m, 2)``, int32 or uint32, on the device, owned by the caller, in canonical order: sorted by b, then by
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
      .def_prop_ro("queue", &DeviceObjects::queue, nb::sig("def queue(self) -> pyopencl.CommandQueue | None"),
                   "The pyopencl.CommandQueue in which all work is done, None for a CUDA device.")
      .def_prop_ro("device", &DeviceObjects::device, "The `Device` of OpenCL.")
      .def_prop_ro(
          "memory", &DeviceObjects::memory, nb::sig("def memory(self) -> dict[str, int]"),
          "OpenCL memory of this object, bytes, without the caller's arrays; as in `BroadPhase.memory`.")
      .def("__repr__", &DeviceObjects::text);
}

}  // namespace broadcl::python
