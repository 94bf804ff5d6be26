#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <broadcl/device.hpp>

#include "opencl/api.hpp"

namespace broadcl::python {

/// A device as DLPack numbers it.
struct TensorDeviceId {
  int kind = 0;
  int index = 0;

  static constexpr int cuda = 2;           ///< kDLCUDA
  static constexpr int cuda_managed = 13;  ///< kDLCUDAManaged
  static constexpr int current = -1;       ///< The index of the device that is current for the caller.
};

/// A device through the interface by which tensors are made: CUDA. OpenCL computes; of this interface are
/// needed memory that OpenCL can use as well, and waiting. That of another vendor is another class with the
/// same functions. What is current for the calling thread stays current.
class TensorDevice {
 public:
  using Address = std::uint64_t;
  using Stream = std::uintptr_t;

  /// Memory of the device.
  struct Memory {
    Address address = 0;
    std::size_t size = 0;
    std::uint64_t handle = 0;       ///< By which its interface knows it.
    std::shared_ptr<void> owner{};  ///< Must be idle when the last one ceases to exist.
  };
  /// Rows that are copied to contiguous memory. Both may be in memory of the host.
  struct Copy {
    Address to = 0, from = 0;
    std::size_t rows = 0;
    std::size_t width = 0;   ///< Bytes of a row.
    std::size_t stride = 0;  ///< Bytes from each row of `from` to the next.
  };

  TensorDevice() = default;
  TensorDevice(const TensorDevice&) = delete;
  TensorDevice& operator=(const TensorDevice&) = delete;
  virtual ~TensorDevice() = default;

  /// Describes it.
  [[nodiscard]] virtual TensorDeviceId id() const = 0;
  /// The device of OpenCL that is the same.
  /// @throws Error if there is none.
  [[nodiscard]] virtual Device find() const = 0;
  /// Makes memory that can be imported, of at least this size.
  /// @throws Error
  [[nodiscard]] virtual Memory make(std::size_t bytes) = 0;
  /// The same memory in a context of the device that find() returns.
  /// @throws Error, cl::Error
  [[nodiscard]] virtual cl::Buffer import(const cl::Context& context, const Memory& memory) = 0;
  /// Waits for what a stream was given before, or without one for all streams; and for copies, which begin
  /// then.
  /// @throws Error
  virtual void wait(std::optional<Stream> stream, std::span<const Copy> copies) = 0;
  /// A stream that producers can make wait for theirs.
  [[nodiscard]] virtual Stream stream() const = 0;
  /// The device that has an address.
  /// @throws Error
  [[nodiscard]] virtual int index_of(Address address) const = 0;
};

/// @throws Error if there is no such device, or no driver.
[[nodiscard]] std::shared_ptr<TensorDevice> open_cuda_device(int index);

}  // namespace broadcl::python
