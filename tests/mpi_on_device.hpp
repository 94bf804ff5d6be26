#pragma once

#include "callers_queue.hpp"  // before <CL/cl.h>: it chooses the version

#include <mpi.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include <broadcl/mpi_opencl.hpp>

#include "base/packed_box.hpp"

namespace broadcl::test {

/// An MpiDeviceBroadPhase with the functions of an MpiBroadPhase, so that the tests of that test this one,
/// too. Boxes are in a buffer with gaps.
class MpiOnDevice : CallersQueue {
 public:
  MpiOnDevice(MPI_Comm comm, const Config& config)
      : broad_phase_(comm, queue_(), {.algorithm = config.algorithm}) {}

  std::uint32_t add(const Aabb& box, const Filter& filter) {
    const auto id = static_cast<std::uint32_t>(std::ranges::find(is_live_, false) - is_live_.begin());
    if (id == is_live_.size()) resize(id + 1);
    is_live_[id] = true;
    boxes_[id] = box;
    set_filter(id, filter);
    return id;
  }
  void move(std::uint32_t id, const Aabb& box) { boxes_[id] = box; }
  void set_filter(std::uint32_t id, const Filter& filter) {
    filters_[id] = filter;
    has_filters_ = has_filters_ || filter != Filter();
  }
  void remove(std::uint32_t id) {
    is_live_[id] = false;
    boxes_[id] = empty_aabb();
  }
  std::span<Aabb> map(std::size_t n) {
    resize(n);
    for (std::size_t id = 0; id < n; ++id) {
      if (!is_live_[id]) filters_[id] = Filter();
      is_live_[id] = true;
    }
    return boxes_;
  }
  void set_exclusions(std::span<const MpiPair> pairs) { broad_phase_.set_exclusions(pairs); }

  /// Makes everything for the next update that is the caller's.
  void prepare() {
    constexpr std::size_t offset = 4;  // in floats
    constexpr std::size_t stride = 9;
    std::vector<float> floats(offset + boxes_.size() * stride);
    for (std::size_t id = 0; id < boxes_.size(); ++id) {
      std::memcpy(&floats[offset + id * stride], &boxes_[id], sizeof(Aabb));
    }
    source_ = buffer_of(floats);
    filter_buffer_ = has_filters_ ? buffer_of(filters_) : cl::Buffer();
    next_ = {.buffer = source_(),
             .count = boxes_.size(),
             .offset = offset * sizeof(float),
             .stride = stride * sizeof(float),
             .filters = filter_buffer_(),
             .worlds = std::ranges::any_of(filters_, [](const Filter& f) { return f.world != 0; })};
  }
  MpiDeviceBroadPhase::Result update() { return broad_phase_.update(next_); }
  using CallersQueue::read;

  std::vector<MpiPair> pairs() {
    const MpiDeviceBroadPhase::Pairs all = broad_phase_.pairs();
    int rank = 0;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    std::vector<MpiPair> pairs;
    for (const auto& [a, b] : read(all.own)) pairs.push_back({mpi_id(rank, a), mpi_id(rank, b)});
    pairs.insert(pairs.end(), all.with_others.begin(), all.with_others.end());
    return pairs;
  }
  [[nodiscard]] std::size_t bytes_sent() const { return broad_phase_.bytes_sent(); }
  [[nodiscard]] std::span<const Stage> profile() const { return broad_phase_.profile(); }

 private:
  void resize(std::size_t n) {
    boxes_.resize(n, empty_aabb());
    filters_.resize(n);
    is_live_.resize(n);
  }

  MpiDeviceBroadPhase broad_phase_;
  std::vector<Aabb> boxes_;  // by id
  std::vector<Filter> filters_;
  std::vector<bool> is_live_;
  bool has_filters_ = false;
  cl::Buffer source_, filter_buffer_;
  DeviceBroadPhase::Boxes next_;
};

inline void prepare(MpiOnDevice& tested) {
  tested.prepare();
}
inline std::vector<Pair> read(const MpiOnDevice& tested, const DeviceBroadPhase::PairBuffer& pairs) {
  return tested.read(pairs);
}

}  // namespace broadcl::test
