/// Pretends to be libcuda.so.1 with two devices and is, in the same library, a layer of OpenCL
/// (OPENCL_LAYERS) with which PoCL imports its memory. Streams are lazy: what is enqueued runs only when
/// something waits for it, so a wait that was forgotten shows in the results; so are copies of OpenCL.
/// PRETENDED_CUDA lists faults.

#define CL_TARGET_OPENCL_VERSION 300

#include <CL/cl_layer.h>
#include <pthread.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace {

using Status = int;  // CUresult
constexpr Status success = 0, invalid_value = 1, out_of_memory = 2, not_initialized = 3, no_device = 100;
constexpr Status invalid_context = 201, operating_system = 304, invalid_handle = 400, illegal_address = 700,
                 not_supported = 801;

constexpr int device_count = 2;
constexpr std::size_t granularity = 2 << 20;
using Address = std::uintptr_t;

struct Stream;
struct Context {
  int device = 0;
  Stream* legacy = nullptr;  // the default stream
};
struct Command {
  std::uint64_t number;
  std::function<void()> run;
};
struct Stream {
  Context* context;
  bool waits_for_legacy;
  std::deque<Command> commands{};
};
struct Event {
  Context* context;
  Stream* stream = nullptr;
  std::uint64_t number = 0;  // of the last command before it
};
struct Memory {
  int descriptor;
  int device;
  std::size_t size;
};
struct Range {
  std::size_t size;
  int device;
};

struct State {
  std::recursive_mutex mutex;
  Status status = not_initialized;
  bool is_forked = false;
  Context contexts[device_count];
  std::list<Stream> streams;  // for good: events may refer to them
  std::uint64_t enqueued = 0;
  std::map<Address, Range> memory;  // mapped or allocated
  int live = 0, copies = 0, calls_after_fork = 0;
};
State& cuda = *new State;  // lives longer than what is destroyed at exit
thread_local std::vector<Context*> current;

bool faulty(const char* fault) {
  const char* const faults = std::getenv("PRETENDED_CUDA");
  return faults != nullptr && std::strstr(faults, fault) != nullptr;
}

void require(bool condition, Status status = invalid_value) {
  if (!condition) throw status;
}

template <class Function>
int call(Function function) {
  const std::scoped_lock lock(cuda.mutex);
  if (cuda.is_forked) return ++cuda.calls_after_fork, not_initialized;
  if (cuda.status != success) return cuda.status;
  try {
    function();
  } catch (Status status) {
    return status;
  }
  return cuda.status;
}

template <class Function>
int call_in_context(Function function) {
  return call([&] { require(!current.empty(), invalid_context), function(); });
}

/// The device that has this memory, or -1.
int device_of(Address start, std::size_t size) {
  const auto next = cuda.memory.upper_bound(start);
  if (next == cuda.memory.begin()) return -1;
  const auto& [first, range] = *std::prev(next);
  return start + size <= first + range.size ? range.device : -1;
}

void run(Stream& stream, std::uint64_t last);

/// Runs what the default stream waits for in others, or they in it.
void run_others(Stream& stream, std::uint64_t last) {
  if (stream.waits_for_legacy) run(*stream.context->legacy, last);
  if (&stream != stream.context->legacy) return;
  for (Stream& other : cuda.streams) {
    if (other.context == stream.context && other.waits_for_legacy) run(other, last);
  }
}

void run(Stream& stream, std::uint64_t last) {
  while (!stream.commands.empty() && stream.commands.front().number <= last) {
    const Command command = std::move(stream.commands.front());
    stream.commands.pop_front();
    run_others(stream, command.number - 1);
    command.run();
  }
}

void synchronize(Stream& stream, std::uint64_t last) {
  run_others(stream, last);
  run(stream, last);
}

void synchronize_all() {
  for (Stream& stream : cuda.streams) run(stream, cuda.enqueued);
}

Stream& to_stream(void* handle) {
  constexpr Address legacy = 1;
  return reinterpret_cast<Address>(handle) <= legacy ? *current.back()->legacy
                                                     : *static_cast<Stream*>(handle);
}

void enqueue(void* stream, std::function<void()> run) {
  to_stream(stream).commands.push_back({++cuda.enqueued, std::move(run)});
}

struct Rows {
  Address start;
  std::size_t pitch;
};

void enqueue_copy(void* stream, Rows to, Rows from, std::size_t width, std::size_t height) {
  const bool to_device = device_of(to.start, width) >= 0, from_device = device_of(from.start, width) >= 0;
  require(from_device || height == 1);
  const std::string staged(reinterpret_cast<char*>(from.start), from_device ? 0 : width);
  enqueue(stream, [=] {
    const auto is_freed = [=](Rows rows) {
      return device_of(rows.start, (height - 1) * rows.pitch + width) < 0;
    };
    if ((to_device && is_freed(to)) || (from_device && is_freed(from))) cuda.status = illegal_address;
    if (cuda.status != success) return;
    const char* const source = from_device ? reinterpret_cast<char*>(from.start) : staged.data();
    for (std::size_t row = 0; row < height; ++row) {
      std::memcpy(reinterpret_cast<char*>(to.start + row * to.pitch), source + row * from.pitch, width);
    }
    if (to_device && from_device) ++cuda.copies;
  });
}

void map(Address start, std::size_t size, int flags, int descriptor) {
  mmap(reinterpret_cast<void*>(start), size, PROT_NONE, flags | MAP_FIXED, descriptor, 0);
}

}  // namespace

extern "C" {

int cuInit(unsigned) {
  const std::scoped_lock lock(cuda.mutex);
  if (cuda.is_forked) return ++cuda.calls_after_fork, not_initialized;
  if (faulty("no-device")) return no_device;
  if (cuda.status != not_initialized) return cuda.status;
  for (int device = 0; device < device_count; ++device) {
    Context& context = cuda.contexts[device];
    context = {device, &cuda.streams.emplace_back(Stream{&context, false})};
  }
  pthread_atfork(nullptr, nullptr, [] { cuda.is_forked = true; });
  return cuda.status = success;
}

int cuGetErrorString(int status, const char** text) {
  *text = status == out_of_memory ? "out of memory"
          : status == no_device   ? "no CUDA-capable device is detected"
                                  : "pretended";
  return success;
}

int cuDeviceGetCount(int* count) {
  return call([&] { *count = device_count; });
}

int cuDeviceGet(int* device, int ordinal) {
  return call([&] {
    require(ordinal >= 0 && ordinal < device_count);
    *device = ordinal;
  });
}

int cuDeviceGetUuid(unsigned char* uuid, int device) {
  return call([&] { std::memset(uuid, faulty("other-uuid") ? 0xff : 0xc0 + device, 16); });
}

int cuDeviceGetPCIBusId(char* text, int size, int device) {
  return call([&] { std::snprintf(text, static_cast<std::size_t>(size), "0000:%02X:00.0", 0xa + device); });
}

int cuDevicePrimaryCtxRetain(Context** context, int device) {
  return call([&] { *context = &cuda.contexts[device]; });
}

int cuCtxPushCurrent_v2(Context* context) {
  return call([&] { current.push_back(context); });
}

int cuCtxPopCurrent_v2(Context** context) {
  return call_in_context([&] {
    if (context != nullptr) *context = current.back();
    current.pop_back();
  });
}

int cuCtxGetCurrent(Context** context) {
  return call([&] { *context = current.empty() ? nullptr : current.back(); });
}

int cuCtxGetDevice(int* device) {
  return call_in_context([&] { *device = current.back()->device; });
}

int cuCtxSynchronize() {
  return call_in_context(synchronize_all);
}

int cuMemGetAllocationGranularity(std::size_t* size, const int*, int) {
  return call([&] { *size = granularity; });
}

int cuMemCreate(Memory** memory, std::size_t size, const int* properties, unsigned long long) {
  return call([&] {
    require(size != 0 && size % granularity == 0);
    require(properties[0] == 1 && properties[1] == 1 &&
            properties[2] == 1);  // pinned, a descriptor, a device
    require(!faulty("no-memory"), out_of_memory);
    const int descriptor = memfd_create("pretended_cuda", MFD_CLOEXEC);
    require(descriptor >= 0, operating_system);
    require(ftruncate(descriptor, static_cast<off_t>(size)) == 0, out_of_memory);
    *memory = new Memory{descriptor, properties[3], size};
    ++cuda.live;
  });
}

int cuMemExportToShareableHandle(int* descriptor, Memory* memory, int type, unsigned long long) {
  return call([&] {
    require(type == 1);
    require(!faulty("no-export"), not_supported);
    *descriptor = dup(memory->descriptor);
    require(*descriptor >= 0, operating_system);
  });
}

int cuMemRelease(Memory* memory) {
  return call([&] {
    close(memory->descriptor);
    delete memory;
    --cuda.live;
  });
}

int cuMemAddressReserve(Address* start, std::size_t size, std::size_t, Address, unsigned long long) {
  return call([&] {
    require(size != 0 && size % granularity == 0);
    *start = reinterpret_cast<Address>(mmap(nullptr, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
    ++cuda.live;
  });
}

int cuMemAddressFree(Address start, std::size_t size) {
  return call([&] {
    require(device_of(start, size) < 0);
    munmap(reinterpret_cast<void*>(start), size);
    --cuda.live;
  });
}

int cuMemMap(Address start, std::size_t size, std::size_t offset, Memory* memory, unsigned long long) {
  return call([&] {
    require(offset == 0 && size == memory->size &&
            cuda.memory.emplace(start, Range{size, memory->device}).second);
    map(start, size, MAP_SHARED, memory->descriptor);
    ++cuda.live;
  });
}

int cuMemSetAccess(Address start, std::size_t size, const int* access, std::size_t count) {
  return call([&] {
    require(count == 1 && access[0] == 1 && access[1] == device_of(start, size) && access[2] == 3);
    mprotect(reinterpret_cast<void*>(start), size, PROT_READ | PROT_WRITE);
  });
}

int cuMemUnmap(Address start, std::size_t size) {
  return call([&] {
    require(cuda.memory.erase(start) == 1);
    map(start, size, MAP_PRIVATE | MAP_ANONYMOUS, -1);
    --cuda.live;
  });
}

int cuMemAlloc_v2(Address* start, std::size_t size) {
  return call_in_context([&] {
    *start = reinterpret_cast<Address>(std::malloc(size));
    cuda.memory[*start] = {size, current.back()->device};
  });
}

int cuMemFree_v2(Address start) {
  return call_in_context([&] {
    synchronize_all();
    require(cuda.memory.erase(start) == 1);
    std::free(reinterpret_cast<void*>(start));
  });
}

int cuPointerGetAttribute(int* device, int attribute, Address start) {
  return call([&] {
    require(attribute == 9 && device_of(start, 1) >= 0);
    *device = device_of(start, 1);
  });
}

int cuStreamCreate(Stream** stream, unsigned flags) {
  return call_in_context([&] {
    *stream = &cuda.streams.emplace_back(Stream{current.back(), flags == 0});
    ++cuda.live;
  });
}

int cuStreamDestroy_v2(Stream*) {
  return call([] { --cuda.live; });
}

int cuStreamSynchronize(void* stream) {
  return call_in_context([&] { synchronize(to_stream(stream), cuda.enqueued); });
}

int cuStreamWaitEvent(void* stream, Event* event, unsigned) {
  return call_in_context([&] {
    if (event->stream == nullptr) return;
    enqueue(stream, [recorded = *event] { synchronize(*recorded.stream, recorded.number); });
  });
}

int cuEventCreate(Event** event, unsigned) {
  return call_in_context([&] {
    *event = new Event{current.back()};
    ++cuda.live;
  });
}

int cuEventRecord(Event* event, void* stream) {
  return call_in_context([&] {
    require(to_stream(stream).context == event->context, invalid_handle);
    *event = {event->context, &to_stream(stream), cuda.enqueued};
  });
}

int cuEventDestroy_v2(Event* event) {
  return call([&] {
    delete event;
    --cuda.live;
  });
}

int cuMemcpyAsync(Address to, Address from, std::size_t size, void* stream) {
  return call_in_context([&] { enqueue_copy(stream, {to, size}, {from, size}, size, 1); });
}

int cuMemcpy2DAsync_v2(const std::size_t* both, void* stream) {  // a CUDA_MEMCPY2D of unified addresses
  return call_in_context([&] {
    const std::size_t width = both[14], height = both[15];
    const auto rows = [width](const std::size_t* side) {
      require(static_cast<int>(side[2]) == 4 && side[0] + width <= side[6] && side[6] <= INT32_MAX);
      return Rows{side[4] + side[1] * side[6] + side[0], side[6]};
    };
    enqueue_copy(stream, rows(both + 7), rows(both), width, height);
  });
}

/// How many objects exist: memory, reservations, mappings, streams, events and imported buffers.
int pretended_cuda_live() {
  return cuda.live;
}

/// From device to device.
int pretended_cuda_copies() {
  return cuda.copies;
}

int pretended_cuda_calls_after_fork() {
  return cuda.calls_after_fork;
}

}  // extern "C"

namespace {

// (From cl_ext.h, whose versions have different ones.)
constexpr cl_device_info uuid_info = 0x106a, pci_info = 0x410f;
constexpr cl_mem_properties opaque_descriptor = 0x2060;

cl_icd_dispatch next, layer;

/// Copies of OpenCL, which are enqueued before whatever else is.
std::vector<std::function<void()>> copies;

cl_int copy_buffer(cl_command_queue queue, cl_mem from, cl_mem to, std::size_t from_offset,
                   std::size_t to_offset, std::size_t size, cl_uint count, const cl_event* list,
                   cl_event* event) {
  if (count != 0 || event != nullptr) {
    return next.clEnqueueCopyBuffer(queue, from, to, from_offset, to_offset, size, count, list, event);
  }
  next.clRetainMemObject(from);
  next.clRetainMemObject(to);
  const std::scoped_lock lock(cuda.mutex);
  copies.emplace_back([=] {
    next.clEnqueueCopyBuffer(queue, from, to, from_offset, to_offset, size, 0, nullptr, nullptr);
    next.clReleaseMemObject(from);
    next.clReleaseMemObject(to);
  });
  return CL_SUCCESS;
}

template <auto function, class... Arguments>
void enqueue_copies_before(cl_int (*cl_icd_dispatch::*)(Arguments...)) {
  layer.*function = [](Arguments... arguments) {
    {
      const std::scoped_lock lock(cuda.mutex);
      for (const auto& enqueue_copy : std::exchange(copies, {})) enqueue_copy();
    }
    return (next.*function)(arguments...);
  };
}

cl_int answer(const void* value, std::size_t size, std::size_t capacity, void* to, std::size_t* needed) {
  if (needed != nullptr) *needed = size;
  if (to != nullptr && capacity < size) return CL_INVALID_VALUE;
  if (to != nullptr) std::memcpy(to, value, size);
  return CL_SUCCESS;
}

unsigned index_of(cl_device_id device) {
  cl_platform_id platform = nullptr;
  cl_device_id devices[device_count] = {};
  next.clGetDeviceInfo(device, CL_DEVICE_PLATFORM, sizeof platform, &platform, nullptr);
  next.clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, device_count, devices, nullptr);
  return device == devices[0] ? 0 : 1;
}

cl_int get_device_info(cl_device_id device, cl_device_info info, std::size_t capacity, void* value,
                       std::size_t* needed) {
  const bool has_uuid = !faulty("no-uuid");
  if (info == CL_DEVICE_EXTENSIONS) {
    char known[4096];
    if (const cl_int status = next.clGetDeviceInfo(device, info, sizeof known, known, nullptr)) return status;
    std::string text = known + std::string(has_uuid ? " cl_khr_device_uuid" : " cl_khr_pci_bus_info");
    if (!faulty("no-extension")) text += " cl_khr_external_memory cl_khr_external_memory_opaque_fd";
    return answer(text.c_str(), text.size() + 1, capacity, value, needed);
  }
  if (info == uuid_info && has_uuid) {
    const std::string uuid(16, static_cast<char>(0xc0 + index_of(device)));
    return answer(uuid.data(), uuid.size(), capacity, value, needed);
  }
  if (info == pci_info && !has_uuid) {
    const cl_uint address[] = {0, 0xa + index_of(device), 0, 0};
    return answer(address, sizeof address, capacity, value, needed);
  }
  return next.clGetDeviceInfo(device, info, capacity, value, needed);
}

/// Buffers that OpenCL has taken over.
std::vector<cl_mem> acquired;

template <bool acquires>
cl_int hand_over(cl_command_queue, cl_uint count, const cl_mem* buffers, cl_uint, const cl_event*,
                 cl_event*) {
  const std::scoped_lock lock(cuda.mutex);
  for (const cl_mem buffer : std::vector(buffers, buffers + count)) {
    const auto at = std::find(acquired.begin(), acquired.end(), buffer);
    if ((at == acquired.end()) != acquires) return CL_INVALID_OPERATION;
    if (acquires) {
      acquired.push_back(buffer);
      ++cuda.live;
    } else {
      acquired.erase(at);
      --cuda.live;
    }
  }
  return CL_SUCCESS;
}

void* find_extension(cl_platform_id platform, const char* name) {
  const std::string function = name;
  if (function == "clEnqueueAcquireExternalMemObjectsKHR") return reinterpret_cast<void*>(&hand_over<true>);
  if (function == "clEnqueueReleaseExternalMemObjectsKHR") return reinterpret_cast<void*>(&hand_over<false>);
  return next.clGetExtensionFunctionAddressForPlatform(platform, name);
}

struct Import {
  int descriptor;
  void* start;
  std::size_t size;
};

void end_import(cl_mem, void* data) {
  const Import& import = *static_cast<Import*>(data);
  munmap(import.start, import.size);
  close(import.descriptor);
  delete &import;
  const std::scoped_lock lock(cuda.mutex);
  --cuda.live;
}

cl_mem create_buffer(cl_context context, const cl_mem_properties* properties, cl_mem_flags flags,
                     std::size_t size, void*, cl_int* status) {
  *status = CL_INVALID_PROPERTY;
  if (faulty("no-import") || properties[0] != opaque_descriptor || properties[2] != 0) return nullptr;
  const int descriptor = static_cast<int>(properties[1]);
  void* const start = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  const cl_mem buffer = next.clCreateBuffer(context, flags | CL_MEM_USE_HOST_PTR, size, start, status);
  if (*status != CL_SUCCESS) return nullptr;
  next.clSetMemObjectDestructorCallback(buffer, end_import, new Import{descriptor, start, size});
  const std::scoped_lock lock(cuda.mutex);
  ++cuda.live;
  return buffer;
}

}  // namespace

extern "C" cl_int clGetLayerInfo(cl_layer_info info, std::size_t capacity, void* value, std::size_t* needed) {
  constexpr cl_layer_api_version version = CL_LAYER_API_VERSION_100;
  return info == CL_LAYER_API_VERSION ? answer(&version, sizeof version, capacity, value, needed)
                                      : CL_INVALID_VALUE;
}

extern "C" cl_int clInitLayer(cl_uint, const cl_icd_dispatch* target, cl_uint* count,
                              const cl_icd_dispatch** dispatch) {
  next = layer = *target;
  layer.clGetDeviceInfo = get_device_info;
  layer.clCreateBufferWithProperties = create_buffer;
  layer.clEnqueueCopyBuffer = copy_buffer;
  enqueue_copies_before<&cl_icd_dispatch::clFinish>(&cl_icd_dispatch::clFinish);
  enqueue_copies_before<&cl_icd_dispatch::clWaitForEvents>(&cl_icd_dispatch::clWaitForEvents);
  enqueue_copies_before<&cl_icd_dispatch::clEnqueueReadBuffer>(&cl_icd_dispatch::clEnqueueReadBuffer);
  enqueue_copies_before<&cl_icd_dispatch::clEnqueueWriteBuffer>(&cl_icd_dispatch::clEnqueueWriteBuffer);
  enqueue_copies_before<&cl_icd_dispatch::clEnqueueNDRangeKernel>(&cl_icd_dispatch::clEnqueueNDRangeKernel);
  layer.clGetExtensionFunctionAddressForPlatform = find_extension;
  *count = sizeof layer / sizeof(void*);
  *dispatch = &layer;
  return CL_SUCCESS;
}
