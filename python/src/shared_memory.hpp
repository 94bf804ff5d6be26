#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "tensor_device.hpp"

namespace broadcl::python {

/// Memory that tensors and OpenCL share, in pieces that are used again: to make and import a block takes
/// longer than an update. Not synchronised: the GIL must be held.
///
/// Tensors may give a piece back before commands that read it have run. It is used again after a wait() that
/// began later. That covers the stream of the boxes; who reads on another one must keep the tensor meanwhile.
class SharedMemory : public std::enable_shared_from_this<SharedMemory> {
 public:
  struct Piece {
    TensorDevice::Address address = 0;
    cl_mem buffer = nullptr;
    std::size_t offset = 0;  ///< In the buffer.
    std::size_t size = 0;
  };
  using Pointer = std::shared_ptr<const Piece>;

  [[nodiscard]] static std::shared_ptr<SharedMemory> create(std::shared_ptr<TensorDevice> device,
                                                            cl::Context context);
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  ~SharedMemory();

  /// A piece of at least this size, which comes back when nobody has it any more. One of at least
  /// `whole_block` bytes begins its buffer.
  /// @throws Error, cl::Error
  [[nodiscard]] Pointer take(std::size_t bytes);
  static constexpr std::size_t whole_block = std::size_t{2} << 20U;

  /// The place of an address in a buffer; null buffer if it is elsewhere.
  [[nodiscard]] Piece find(TensorDevice::Address address) const noexcept;

  /// Waits as the device does, without the GIL.
  void wait(std::optional<TensorDevice::Stream> stream, std::span<const TensorDevice::Copy> copies);

  /// Gives back blocks of which no piece is in use.
  void shrink();

  [[nodiscard]] TensorDevice& device() const noexcept { return *device_; }

 private:
  SharedMemory(std::shared_ptr<TensorDevice> device, cl::Context context);

  struct Slot {
    Piece piece;
    bool is_used = false;
    std::uint64_t returned = 0;  // how many waits had begun
  };
  struct Block {
    TensorDevice::Memory memory;
    cl::Buffer buffer;
    std::vector<Slot> slots;  // all of one size
  };

  Slot& free_slot(std::size_t size);
  Block make(std::size_t size);

  std::shared_ptr<TensorDevice> device_;
  cl::Context context_;
  std::list<Block> blocks_;
  std::uint64_t begun_ = 1, complete_ = 1;  // waits
};

}  // namespace broadcl::python
