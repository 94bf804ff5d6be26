#include <dlfcn.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/error.hpp>

#include "opencl/process.hpp"
#include "tensor_device.hpp"

namespace broadcl::python {
namespace {

using Context = struct CUctx*;
using CudaStream = struct CUstream*;
using Event = struct CUevent*;
using CudaAddress = unsigned long long;

// From cuda.h.
constexpr int out_of_memory = 2;
constexpr int operating_system = 304;
constexpr int pinned_memory = 1;      // CU_MEM_ALLOCATION_TYPE_PINNED
constexpr int file_descriptor = 1;    // CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR
constexpr int on_device = 1;          // CU_MEM_LOCATION_TYPE_DEVICE
constexpr int readable_writable = 3;  // CU_MEM_ACCESS_FLAGS_PROT_READWRITE
constexpr int device_ordinal = 9;     // CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL
constexpr unsigned no_timing = 2;     // CU_EVENT_DISABLE_TIMING
constexpr unsigned not_blocking = 1;  // CU_STREAM_NON_BLOCKING
constexpr int unified = 4;            // CU_MEMORYTYPE_UNIFIED

struct Location {
  int type = on_device;
  int device = 0;
};
struct Allocation {  // CUmemAllocationProp
  int type = pinned_memory;
  int handle_types = file_descriptor;
  Location location{};
  void* unused = nullptr;
  std::array<unsigned char, 8> flags{};
};
struct Access {  // CUmemAccessDesc
  Location location{};
  int flags = readable_writable;
};
struct Copy2D {  // CUDA_MEMCPY2D
  struct Side {
    std::size_t x = 0, y = 0;
    int type = unified;
    void* host = nullptr;
    CudaAddress address = 0;
    void* array = nullptr;
    std::size_t pitch = 0;
  };
  Side from, to;
  std::size_t width = 0, height = 0;
};

/// Opened once, by the first thread that needs it, and never closed, because it starts its own threads.
void* library() {
  static void* const handle = dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) {
    throw Error(
        "there is no libcuda.so.1, of NVIDIA's driver, which tensors of CUDA need; install the driver, or "
        "copy "
        "boxes to the host and use a BroadPhase");
  }
  return handle;
}

template <class Function>
Function find_function(const char* name) {
  void* const function = dlsym(library(), name);
  if (function == nullptr) {
    throw Error(
        "libcuda.so.1 has no " + std::string(name) +
        ", so it is older than CUDA 10.2; install a newer driver, or copy boxes to the host and use a "
        "BroadPhase");
  }
  return reinterpret_cast<Function>(function);
}

/// The functions of the driver that are called.
struct Driver {
#define BROADCL_CUDA(name, ...) int (*name)(__VA_ARGS__) = find_function<int (*)(__VA_ARGS__)>(#name)
  BROADCL_CUDA(cuInit, unsigned);
  BROADCL_CUDA(cuGetErrorString, int, const char**);
  BROADCL_CUDA(cuDeviceGetCount, int*);
  BROADCL_CUDA(cuDeviceGet, int*, int);
  BROADCL_CUDA(cuDeviceGetUuid, std::array<unsigned char, 16>*, int);
  BROADCL_CUDA(cuDeviceGetPCIBusId, char*, int, int);
  BROADCL_CUDA(cuDevicePrimaryCtxRetain, Context*, int);
  BROADCL_CUDA(cuCtxPushCurrent_v2, Context);
  BROADCL_CUDA(cuCtxPopCurrent_v2, Context*);
  BROADCL_CUDA(cuCtxGetDevice, int*);
  BROADCL_CUDA(cuCtxSynchronize, void);
  BROADCL_CUDA(cuMemGetAllocationGranularity, std::size_t*, const Allocation*, int);
  BROADCL_CUDA(cuMemCreate, CudaAddress*, std::size_t, const Allocation*, CudaAddress);
  BROADCL_CUDA(cuMemExportToShareableHandle, void*, CudaAddress, int, CudaAddress);
  BROADCL_CUDA(cuMemAddressReserve, CudaAddress*, std::size_t, std::size_t, CudaAddress, CudaAddress);
  BROADCL_CUDA(cuMemMap, CudaAddress, std::size_t, std::size_t, CudaAddress, CudaAddress);
  BROADCL_CUDA(cuMemSetAccess, CudaAddress, std::size_t, const Access*, std::size_t);
  BROADCL_CUDA(cuMemUnmap, CudaAddress, std::size_t);
  BROADCL_CUDA(cuMemAddressFree, CudaAddress, std::size_t);
  BROADCL_CUDA(cuMemRelease, CudaAddress);
  BROADCL_CUDA(cuPointerGetAttribute, void*, int, CudaAddress);
  BROADCL_CUDA(cuStreamCreate, CudaStream*, unsigned);
  BROADCL_CUDA(cuStreamDestroy_v2, CudaStream);
  BROADCL_CUDA(cuStreamSynchronize, CudaStream);
  BROADCL_CUDA(cuStreamWaitEvent, CudaStream, Event, unsigned);
  BROADCL_CUDA(cuEventCreate, Event*, unsigned);
  BROADCL_CUDA(cuEventRecord, Event, CudaStream);
  BROADCL_CUDA(cuEventDestroy_v2, Event);
  BROADCL_CUDA(cuMemcpyAsync, CudaAddress, CudaAddress, std::size_t, CudaStream);
  BROADCL_CUDA(cuMemcpy2DAsync_v2, const Copy2D*, CudaStream);
#undef BROADCL_CUDA
};

/// @throws Error
const Driver& driver() {
  static const Driver the_driver;
  return the_driver;
}

/// @param result Of a call of CUDA.
/// @throws Error if it failed.
void check(int result, const char* call) {
  if (result == 0) return;
  const char* text = nullptr;
  if (driver().cuGetErrorString(result, &text) != 0 || text == nullptr) text = "unknown error";
  const std::string remedy =
      result == operating_system
          ? "; each block of shared memory has a file descriptor, of which `ulimit -n` allows more"
          : "";
  throw Error(
      "CUDA: " + std::string(call) + " failed: " + text + " (" + std::to_string(result) + ")" + remedy,
      result == out_of_memory ? ErrorKind::out_of_device_memory : ErrorKind::other);
}

/// Makes a context current for this thread as long as it exists.
class Current {
 public:
  explicit Current(Context context) {
    opencl::use_in_this_process();  // after a fork, CUDA does not work either
    check(driver().cuCtxPushCurrent_v2(context), "cuCtxPushCurrent");
  }
  ~Current() {
    Context context = nullptr;
    (void)driver().cuCtxPopCurrent_v2(&context);
  }
  Current(const Current&) = delete;
  Current& operator=(const Current&) = delete;
};

/// Memory, at an address from when it has one.
struct Mapping {
  explicit Mapping(Context in, std::size_t bytes) : context(in), size(bytes) {}
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  ~Mapping() {
    if (driver().cuCtxPushCurrent_v2(context) != 0) return;
    if (is_mapped) (void)driver().cuMemUnmap(address, size);
    if (address != 0) (void)driver().cuMemAddressFree(address, size);
    if (handle != 0) (void)driver().cuMemRelease(handle);
    (void)driver().cuCtxPopCurrent_v2(&context);
  }

  Context context;
  std::size_t size;
  CudaAddress handle = 0, address = 0;
  bool is_mapped = false;
};

std::string hexadecimal(const std::array<unsigned char, 16>& bytes) {
  std::string text;
  for (const unsigned char byte : bytes) {
    text += "0123456789abcdef"[byte >> 4U];
    text += "0123456789abcdef"[byte & 15U];
  }
  return text;
}

/// The function of OpenCL 3.0, which libraries that work with OpenCL 1.2 do not declare.
auto find_create_buffer() {
  using Create = cl_mem (*)(cl_context, const cl_ulong*, cl_mem_flags, std::size_t, void*, cl_int*);
  void* const loader = dlopen("libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
  auto* const create =
      loader == nullptr ? nullptr : reinterpret_cast<Create>(dlsym(loader, "clCreateBufferWithProperties"));
  if (create == nullptr)
    throw Error("OpenCL's loader, libOpenCL.so.1, is older than OpenCL 3.0; install a newer one");
  return create;
}

class CudaDevice final : public TensorDevice {
 public:
  explicit CudaDevice(int index) : index_(index) {
    check(driver().cuDeviceGet(&device_, index), "cuDeviceGet");
    check(driver().cuDevicePrimaryCtxRetain(&context_, device_), "cuDevicePrimaryCtxRetain");  // for good
    const Current current(context_);
    check(driver().cuEventCreate(&event_, no_timing), "cuEventCreate");
    if (const int result = driver().cuStreamCreate(&stream_, not_blocking); result != 0) {
      (void)driver().cuEventDestroy_v2(event_);
      check(result, "cuStreamCreate");
    }
  }
  CudaDevice(const CudaDevice&) = delete;
  CudaDevice& operator=(const CudaDevice&) = delete;
  ~CudaDevice() override {
    if (driver().cuCtxPushCurrent_v2(context_) != 0) return;
    (void)driver().cuStreamDestroy_v2(stream_);
    (void)driver().cuEventDestroy_v2(event_);
    (void)driver().cuCtxPopCurrent_v2(&context_);
  }

  TensorDeviceId id() const override { return {.kind = TensorDeviceId::cuda, .index = index_}; }

  Device find() const override {
    std::array<unsigned char, 16> bytes{};
    check(driver().cuDeviceGetUuid(&bytes, device_), "cuDeviceGetUuid");
    const std::string uuid = hexadecimal(bytes);
    std::array<char, 32> address{};
    check(driver().cuDeviceGetPCIBusId(address.data(), address.size(), device_), "cuDeviceGetPCIBusId");
    std::string pci = address.data();
    std::ranges::transform(pci, pci.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (const Device& device : devices()) {
      if (device.uuid.empty() ? device.pci_address == pci : device.uuid == uuid) return device;
    }
    throw Error("no OpenCL device is the CUDA device " + std::to_string(index_) + " (" + pci + ", UUID " +
                uuid +
                "); install NVIDIA's OpenCL driver (`clinfo -l` must show the device), or copy boxes to the "
                "host and use a BroadPhase");
  }

  Memory make(std::size_t bytes) override {
    const Current current(context_);
    Allocation allocation;
    allocation.location.device = device_;
    std::size_t granularity = 0;
    check(driver().cuMemGetAllocationGranularity(&granularity, &allocation, 0),
          "cuMemGetAllocationGranularity");
    auto mapping = std::make_shared<Mapping>(context_, (bytes + granularity - 1) / granularity * granularity);
    check(driver().cuMemCreate(&mapping->handle, mapping->size, &allocation, 0), "cuMemCreate");
    check(driver().cuMemAddressReserve(&mapping->address, mapping->size, 0, 0, 0), "cuMemAddressReserve");
    check(driver().cuMemMap(mapping->address, mapping->size, 0, mapping->handle, 0), "cuMemMap");
    mapping->is_mapped = true;
    Access access;
    access.location.device = device_;
    check(driver().cuMemSetAccess(mapping->address, mapping->size, &access, 1), "cuMemSetAccess");
    return {.address = mapping->address, .size = mapping->size, .handle = mapping->handle, .owner = mapping};
  }

  cl::Buffer import(const cl::Context& context, const Memory& memory) override {
    static const auto create = find_create_buffer();
    const Current current(context_);
    int descriptor = -1;
    check(driver().cuMemExportToShareableHandle(&descriptor, memory.handle, file_descriptor, 0),
          "cuMemExportToShareableHandle");
    constexpr cl_ulong opaque_descriptor = 0x2060;  // CL_EXTERNAL_MEMORY_HANDLE_OPAQUE_FD_KHR
    const std::array<cl_ulong, 3> properties = {opaque_descriptor, static_cast<cl_ulong>(descriptor), 0};
    cl_int error = CL_SUCCESS;
    cl_mem const buffer =
        create(context(), properties.data(), CL_MEM_READ_WRITE, memory.size, nullptr, &error);
    if (error != CL_SUCCESS) {
      (void)close(descriptor);  // otherwise OpenCL owns it
      throw cl::Error(error, "clCreateBufferWithProperties");
    }
    return cl::Buffer(buffer);
  }

  void wait(std::optional<Stream> stream, std::span<const Copy> copies) override {
    const Current current(context_);
    if (!stream) {
      check(driver().cuCtxSynchronize(), "cuCtxSynchronize");
    } else if (*stream != this->stream()) {
      check(driver().cuEventRecord(event_, reinterpret_cast<CudaStream>(*stream)), "cuEventRecord");
      check(driver().cuStreamWaitEvent(stream_, event_, 0), "cuStreamWaitEvent");
    }
    for (const Copy& copy : copies) {
      if (copy.rows == 1 || copy.stride == copy.width) {
        check(driver().cuMemcpyAsync(copy.to, copy.from, copy.rows * copy.width, stream_), "cuMemcpyAsync");
      } else {
        const Copy2D rows{.from = {.address = copy.from, .pitch = copy.stride},
                          .to = {.address = copy.to, .pitch = copy.width},
                          .width = copy.width,
                          .height = copy.rows};
        check(driver().cuMemcpy2DAsync_v2(&rows, stream_), "cuMemcpy2DAsync");
      }
    }
    check(driver().cuStreamSynchronize(stream_), "cuStreamSynchronize");
  }

  Stream stream() const override { return reinterpret_cast<Stream>(stream_); }

  int index_of(Address address) const override {
    int index = -1;
    const Current current(context_);
    check(driver().cuPointerGetAttribute(&index, device_ordinal, address), "cuPointerGetAttribute");
    return index;
  }

 private:
  int index_;
  int device_ = 0;
  Context context_ = nullptr;
  CudaStream stream_ = nullptr;
  Event event_ = nullptr;
};

}  // namespace

std::shared_ptr<TensorDevice> open_cuda_device(int index) {
  opencl::use_in_this_process();
  check(driver().cuInit(0), "cuInit");
  if (index == TensorDeviceId::current && driver().cuCtxGetDevice(&index) != 0) index = 0;
  int count = 0;
  check(driver().cuDeviceGetCount(&count), "cuDeviceGetCount");
  if (index >= count) {
    throw Error::invalid_argument("there is no CUDA device " + std::to_string(index) + ", only " +
                                  std::to_string(count) + "; CUDA_VISIBLE_DEVICES may hide others");
  }
  return {new CudaDevice(index), opencl::DeleteUnlessForked()};
}

}  // namespace broadcl::python
