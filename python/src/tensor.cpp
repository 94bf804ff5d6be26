#include "tensor.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstdint>
#include <utility>

#include "classes.hpp"
#include "gil.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace broadcl::python {
namespace {

constexpr int cpu = 1;        // kDLCPU
constexpr int cuda_host = 3;  // kDLCUDAHost

bool is_in_host_memory(const TensorDeviceId& id) {
  return id.kind == cpu || id.kind == cuda_host;
}

/// A pair of integers (a kind, which may be an enumerator, and an index).
std::optional<TensorDeviceId> to_pair(nb::handle pair) {
  if (!nb::isinstance<nb::tuple>(pair) || nb::len(pair) != 2) return std::nullopt;
  return TensorDeviceId{.kind = nb::cast<int>(nb::int_(pair[0])), .index = nb::cast<int>(nb::int_(pair[1]))};
}

/// Where a tensor is, if this is one with DLPack.
std::optional<TensorDeviceId> place_of(nb::handle tensor) {
  if (!nb::hasattr(tensor, "__dlpack_device__")) return std::nullopt;
  return to_pair(tensor.attr("__dlpack_device__")());
}

std::string name_of(nb::dlpack::dtype dtype) {
  const std::array<const char*, 7> kinds = {"int", "uint", "float", "handle", "bfloat", "complex", "bool"};
  const std::string kind = dtype.code < kinds.size() ? kinds.at(dtype.code) : "type";
  return kind + std::to_string(dtype.bits * dtype.lanes);
}

/// The table of functions by which a library offers its tensors to C, of DLPack 1.2.
struct ExchangeApi {
  std::uint32_t major, minor;
  void* older;
  std::array<void*, 4> unused;
  int (*current_stream)(int kind, std::int32_t index, void** stream);
};

/// The stream that is current in the library of a tensor, if that says which in C: for PyTorch, to have a
/// stream wait for it in Python takes longer than the update of few boxes does on the device.
std::optional<TensorDevice::Stream> current_stream(nb::handle tensor, const TensorDeviceId& id) {
  const nb::object capsule = nb::getattr(tensor.type(), "__dlpack_c_exchange_api__", nb::none());
  if (!PyCapsule_IsValid(capsule.ptr(), "dlpack_exchange_api")) return std::nullopt;
  const auto* api =
      static_cast<const ExchangeApi*>(PyCapsule_GetPointer(capsule.ptr(), "dlpack_exchange_api"));
  if (api->major != 1) return std::nullopt;
  void* stream = nullptr;
  if (api->current_stream(id.kind, id.index, &stream) != 0) throw nb::python_error();
  return reinterpret_cast<TensorDevice::Stream>(stream);
}

void refuse_other_device(const TensorDeviceId& own, const TensorDeviceId& expected, const std::string& name) {
  if (own.index == expected.index) return;
  throw nb::value_error((name + " must be on the CUDA device " + std::to_string(expected.index) + ", not " +
                         std::to_string(own.index) + "; copy it, or use an object of that device")
                            .c_str());
}

}  // namespace

bool is_device_tensor(nb::handle object) {
  if (const auto id = place_of(object)) return !is_in_host_memory(*id);
  return nb::hasattr(object, "__cuda_array_interface__");
}

std::optional<TensorDeviceId> to_device_id(nb::handle object) {
  if (auto id = to_pair(object)) return id;
  if (auto id = place_of(object)) return id;
  if (nb::hasattr(object, "__cuda_array_interface__")) {  // which does not say where it is
    const auto address = nb::cast<TensorDevice::Address>(object.attr("__cuda_array_interface__")["data"][0]);
    const auto device = open_cuda_device(TensorDeviceId::current);
    return TensorDeviceId{TensorDeviceId::cuda,
                          address == 0 ? device->id().index : device->index_of(address)};
  }
  if (nb::hasattr(object, "local_hardware_id")) {  // JAX, whose names count the devices of all processes
    if (!std::string(nb::str(object).c_str()).starts_with("cuda")) return std::nullopt;
    return TensorDeviceId{TensorDeviceId::cuda, nb::cast<int>(object.attr("local_hardware_id"))};
  }
  std::string text = nb::str(object).c_str();
  if (text == "cuda") return TensorDeviceId{TensorDeviceId::cuda, TensorDeviceId::current};
  for (const std::string before : {"cuda:", "<CUDA Device "}) {  // (the second is CuPy's)
    if (!text.starts_with(before)) continue;
    text.erase(0, before.size());
    if (text.ends_with('>')) text.pop_back();
    if (text.empty() || text.size() > 4 || text.find_first_not_of("0123456789") != std::string::npos) break;
    return TensorDeviceId{TensorDeviceId::cuda, std::stoi(text)};
  }
  return std::nullopt;
}

Tensor::Tensor(nb::handle object, const TensorDevice& device, const std::string& name) {
  const auto id = place_of(object);
  if (id && is_in_host_memory(*id)) {
    throw nb::type_error(
        (name + " must be on a CUDA device, not in host memory; copy it there, or use a BroadPhase, or "
                "overlapping_pairs() with all boxes on the host")
            .c_str());
  }
  if (id && id->kind != TensorDeviceId::cuda && id->kind != TensorDeviceId::cuda_managed) {
    throw nb::type_error(
        (name + " must be on a CUDA device, not on one of the kind " + std::to_string(id->kind) +
         " of DLPack, which cannot share memory with OpenCL; copy it to the host, and use a BroadPhase")
            .c_str());
  }
  if (id) {
    // (Managed memory says 0.)
    if (id->kind == TensorDeviceId::cuda) refuse_other_device(*id, device.id(), name);
    const auto current = current_stream(object, *id);
    if (!nb::isinstance<DeviceArray>(object)) stream = current.value_or(device.stream());
    const nb::object capsule = current ? object.attr("__dlpack__")("stream"_a = -1)
                                       : object.attr("__dlpack__")("stream"_a = device.stream());
    array = nb::cast<nb::ndarray<nb::ro>>(capsule);
    layout.dtype = name_of(array.dtype());
    const auto bytes = static_cast<std::ptrdiff_t>(array.itemsize());
    for (std::size_t i = 0; i < array.ndim(); ++i) {
      layout.shape.push_back(array.shape(i));
      layout.strides.push_back(static_cast<std::ptrdiff_t>(array.stride(i)) * bytes);
    }
    address = reinterpret_cast<TensorDevice::Address>(array.data());
    return;
  }
  if (!nb::hasattr(object, "__cuda_array_interface__")) {
    throw nb::type_error((name + " must be a tensor of CUDA, not " + kind_of(object) +
                          "; for arrays in host memory, use a BroadPhase or overlapping_pairs()")
                             .c_str());
  }
  const nb::dict interface(object.attr("__cuda_array_interface__"));
  const nb::object type = nb::module_::import_("numpy").attr("dtype")(interface["typestr"]);
  layout.dtype = nb::cast<std::string>(nb::str(type));
  layout.shape = nb::cast<std::vector<std::size_t>>(interface["shape"]);
  const nb::object strides = interface.contains("strides") ? nb::object(interface["strides"]) : nb::none();
  if (!strides.is_none()) {
    layout.strides = nb::cast<std::vector<std::ptrdiff_t>>(strides);
  } else {
    layout.strides.resize(layout.shape.size());
    auto next = nb::cast<std::ptrdiff_t>(type.attr("itemsize"));
    for (std::size_t i = layout.shape.size(); i-- > 0;) {
      layout.strides[i] = next;
      next *= static_cast<std::ptrdiff_t>(layout.shape[i]);
    }
  }
  address = nb::cast<TensorDevice::Address>(interface["data"][0]);
  if (address != 0) refuse_other_device({.index = device.index_of(address)}, device.id(), name);
  const nb::object producer = interface.contains("stream") ? nb::object(interface["stream"]) : nb::none();
  constexpr TensorDevice::Stream legacy = 1;  // which waits for all streams that do not say otherwise
  stream = producer.is_none() ? legacy : nb::cast<TensorDevice::Stream>(producer);
}

DeviceArray::DeviceArray(SharedMemory::Pointer memory, std::shared_ptr<SharedMemory> of,
                         TensorDeviceId device, std::vector<std::size_t> shape, std::string dtype)
    : of_(std::move(of)),
      memory_(std::move(memory)),
      device_(device),
      shape_(std::move(shape)),
      dtype_(std::move(dtype)) {}

nb::object DeviceArray::dlpack(nb::handle self, nb::handle max_version, nb::handle dl_device,
                               nb::handle copy) const {
  if (copy.is(Py_True))
    throw nb::buffer_error("a DeviceArray cannot be copied by DLPack; copy it afterwards");
  if (const auto id = to_pair(dl_device);
      !dl_device.is_none() && (!id || id->kind != device_.kind || id->index != device_.index)) {
    throw nb::buffer_error("a DeviceArray is on a CUDA device; get() copies it to the host");
  }
  (void)max_version;  // the oldest, which all consumers accept
  const nb::dlpack::dtype type{.code = static_cast<std::uint8_t>(dtype_ == "float32" ? 2
                                                                 : dtype_ == "int32" ? 0
                                                                                     : 1),
                               .bits = 32,
                               .lanes = 1};
  void* const data = memory_ == nullptr ? nullptr : reinterpret_cast<void*>(memory_->address);
  nb::ndarray<> array(data, shape_.size(), shape_.data(), self, nullptr, type, device_.kind, device_.index);
  nb::object result = array.cast(nb::rv_policy::reference);
  if (!PyCapsule_CheckExact(result.ptr())) result = result.attr("__dlpack__")();  // depends on nanobind
  return result;
}

nb::tuple DeviceArray::dlpack_device() const {
  return nb::make_tuple(device_.kind, device_.index);
}

nb::tuple DeviceArray::shape() const {
  nb::list numbers;
  for (const std::size_t number : shape_) numbers.append(number);
  return nb::tuple(numbers);
}

nb::object DeviceArray::dtype() const {
  return nb::module_::import_("numpy").attr("dtype")(dtype_);
}

nb::dict DeviceArray::cuda_array_interface() const {
  nb::dict interface;
  interface["shape"] = shape();
  interface["typestr"] = dtype().attr("str");
  interface["data"] = nb::make_tuple(memory_ == nullptr ? 0 : memory_->address, false);
  interface["strides"] = nb::none();
  interface["stream"] = nb::none();  // it is complete
  interface["version"] = 3;
  return interface;
}

nb::object DeviceArray::get() const {
  const nb::object array = nb::module_::import_("numpy").attr("empty")(shape(), dtype_);
  if (memory_ == nullptr) return array;
  const auto bytes = nb::cast<std::size_t>(array.attr("nbytes"));
  const TensorDevice::Copy copy{.to = nb::cast<TensorDevice::Address>(array.attr("ctypes").attr("data")),
                                .from = memory_->address,
                                .rows = 1,
                                .width = bytes,
                                .stride = bytes};
  const GilReleased released;
  of_->device().wait(of_->device().stream(), std::span(&copy, 1));
  return array;
}

DeviceArray DeviceArray::view(nb::handle dtype) const {
  const nb::object type = nb::module_::import_("numpy").attr("dtype")(dtype);
  const auto name = nb::cast<std::string>(nb::str(type));
  if ((name != "int32" && name != "uint32") || dtype_ == "float32") {
    throw nb::type_error(("integers can be shown as int32 or uint32, not " + dtype_ + " as " + name).c_str());
  }
  DeviceArray other(*this);
  other.dtype_ = name;
  return other;
}

void add_device_array(nb::module_& module) {
  nb::class_<DeviceArray>(
      module, "DeviceArray",
      R"(An array in memory of a CUDA device, for any library with DLPack or the CUDA array interface.

``torch.from_dlpack(array)``, ``jax.dlpack.from_dlpack(array)``, ``cupy.from_dlpack(array)`` and
``warp.from_dlpack(array)`` show the same memory, which stays valid as long as one of them lives; it is
complete, so any stream may read it. Afterwards it is used again, by an update that waits for the stream of
its boxes: keep what another stream still reads.)")
      .def(
          "__dlpack__",
          [](nb::handle self, nb::handle /*stream*/, nb::handle max_version, nb::handle dl_device,
             nb::handle copy) {
            return nb::cast<const DeviceArray&>(self).dlpack(self, max_version, dl_device, copy);
          },
          nb::kw_only(), "stream"_a = nb::none(), "max_version"_a = nb::none(), "dl_device"_a = nb::none(),
          "copy"_a = nb::none(),
          nb::sig("def __dlpack__(self, *, stream: int | None = None, max_version: tuple[int, int] | None = "
                  "None, "
                  "dl_device: tuple[int, int] | None = None, copy: bool | None = None) -> object"),
          "A capsule with a DLManagedTensor (DLPack, Python specification).")
      .def("__dlpack_device__", &DeviceArray::dlpack_device,
           nb::sig("def __dlpack_device__(self) -> tuple[int, int]"), "(2, index): kDLCUDA.")
      .def_prop_ro("__cuda_array_interface__", &DeviceArray::cuda_array_interface,
                   nb::sig("def __cuda_array_interface__(self) -> dict[str, object]"),
                   "Version 3 of the CUDA array interface.")
      .def_prop_ro("shape", &DeviceArray::shape, nb::sig("def shape(self) -> tuple[int, ...]"), "Its shape.")
      .def_prop_ro("dtype", &DeviceArray::dtype, nb::sig("def dtype(self) -> numpy.dtype[typing.Any]"),
                   "As in NumPy.")
      .def("__len__", &DeviceArray::size)
      .def("__repr__",
           [](const DeviceArray& array) {
             return nb::str("DeviceArray(shape={}, dtype={}, device='cuda:{}')")
                 .format(array.shape(), array.dtype(), array.dlpack_device()[1]);
           })
      .def("get", &DeviceArray::get, nb::sig("def get(self) -> numpy.typing.NDArray[typing.Any]"),
           R"(Copies the array to the host.

Returns
-------
numpy.ndarray
    A copy.

Raises
------
Error
    If CUDA fails.)")
      .def("view", &DeviceArray::view, "dtype"_a,
           nb::sig("def view(self, dtype: numpy.typing.DTypeLike) -> DeviceArray"),
           R"(Shows the same memory as unsigned or as signed integers.

Parameters
----------
dtype : numpy.int32 or numpy.uint32
    The type. Indices are below 2^31, so both show the same numbers.

Returns
-------
DeviceArray
    It keeps the memory, too.

Raises
------
TypeError
    For another type.)");
}

}  // namespace broadcl::python
