#include "shared_memory.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include <broadcl/error.hpp>

#include "gil.hpp"
#include "opencl/process.hpp"

namespace broadcl::python {
namespace {

/// Two sizes between each power of two and the next.
std::size_t rounded(std::size_t bytes) {
  constexpr std::size_t least = 4096;
  const std::size_t power = std::bit_ceil(std::max(bytes, least));
  return bytes <= power / 4 * 3 ? power / 4 * 3 : power;
}

}  // namespace

std::shared_ptr<SharedMemory> SharedMemory::create(std::shared_ptr<TensorDevice> device,
                                                   cl::Context context) {
  return {new SharedMemory(std::move(device), std::move(context)), opencl::DeleteUnlessForked()};
}

SharedMemory::SharedMemory(std::shared_ptr<TensorDevice> device, cl::Context context)
    : device_(std::move(device)), context_(std::move(context)) {}

SharedMemory::~SharedMemory() {
  try {
    device_->wait(std::nullopt, {});
  } catch (const Error&) {
    // The device is lost, and nothing reads the memory any more.
  }
}

SharedMemory::Pointer SharedMemory::take(std::size_t bytes) {
  const std::size_t size = rounded(bytes);
  Slot& slot = free_slot(size);
  slot.is_used = true;
  const auto give_back = [self = shared_from_this(), &slot](const Piece*) {
    slot.is_used = false;
    slot.returned = self->begun_;
  };
  return Pointer(&slot.piece, give_back);
}

SharedMemory::Slot& SharedMemory::free_slot(std::size_t size) {
  const auto find = [&](std::uint64_t complete) -> Slot* {
    for (Block& block : blocks_) {
      if (block.slots.front().piece.size != size) continue;
      for (Slot& slot : block.slots) {
        if (!slot.is_used && slot.returned < complete) return &slot;
      }
    }
    return nullptr;
  };
  if (Slot* slot = find(complete_)) return *slot;
  if (find(~std::uint64_t{0}) != nullptr) {
    wait(std::nullopt, {});
    if (Slot* slot = find(complete_)) return *slot;
  }
  blocks_.push_back(make(size));
  return blocks_.back().slots.front();
}

SharedMemory::Block SharedMemory::make(std::size_t size) {
  Block block;
  block.memory = device_->make(std::max(size, whole_block));
  block.buffer = device_->import(context_, block.memory);
  for (std::size_t offset = 0; offset + size <= std::max(size, whole_block); offset += size) {
    block.slots.push_back({.piece = {.address = block.memory.address + offset,
                                     .buffer = block.buffer(),
                                     .offset = offset,
                                     .size = size}});
  }
  return block;
}

SharedMemory::Piece SharedMemory::find(TensorDevice::Address address) const noexcept {
  for (const Block& block : blocks_) {
    const TensorDevice::Address offset = address - block.memory.address;
    if (offset < block.memory.size) {
      return {
          .address = address, .buffer = block.buffer(), .offset = offset, .size = block.memory.size - offset};
    }
  }
  return {};
}

void SharedMemory::wait(std::optional<TensorDevice::Stream> stream,
                        std::span<const TensorDevice::Copy> copies) {
  const std::uint64_t begun = ++begun_;
  {
    const GilReleased released;
    device_->wait(stream, copies);
  }
  complete_ = std::max(complete_, begun);
}

void SharedMemory::shrink() {
  wait(std::nullopt, {});
  std::erase_if(blocks_,
                [](const Block& block) { return std::ranges::none_of(block.slots, &Slot::is_used); });
}

}  // namespace broadcl::python
