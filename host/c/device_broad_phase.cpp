#define CL_TARGET_OPENCL_VERSION 120  // before <CL/cl.h>

#include <broadcl/broadcl.h>
#include <broadcl/opencl.hpp>

#include <cstddef>
#include <vector>

#include "c/call.hpp"
#include "c/convert.hpp"

struct broadcl_device_broad_phase {
  broadcl::DeviceBroadPhase broad_phase;
  broadcl::c::DeviceFacts device{broad_phase.device()};
  std::vector<broadcl_stage> stages{};  ///< What broadcl_device_broad_phase_profile() has returned.
};

using namespace broadcl;

namespace {

DeviceBroadPhase& object(broadcl_device_broad_phase* handle) {
  return c::required(handle, "broad_phase").broad_phase;
}

DeviceBroadPhase::Config to_config(const broadcl_device_config* config) {
  const broadcl_device_config given = c::read_optional(config, "config");
  DeviceBroadPhase::Config result;
  if (given.algorithm != nullptr) result.algorithm = given.algorithm;
  result.profile = given.profile != 0;
  result.on_compile = c::to_handler(given.on_compile, given.on_compile_data);
  return result;
}

DeviceBroadPhase::Boxes to_boxes(const broadcl_device_boxes* boxes) {
  const broadcl_device_boxes given = c::read(boxes, "boxes");
  DeviceBroadPhase::Boxes result{.buffer = given.buffer,
                                 .count = given.count,
                                 .offset = given.offset,
                                 .stride = given.stride,
                                 .filters = given.filters,
                                 .worlds = given.worlds != 0,
                                 .ordered_worlds = given.ordered_worlds};
  result.second = {.buffer = given.second_buffer,
                   .count = given.second_count,
                   .offset = given.second_offset,
                   .stride = given.second_stride};
  return result;
}

DeviceBroadPhase::ChangeBuffers to_changes(const broadcl_change_buffers* changes) {
  const broadcl_change_buffers given = c::read(changes, "changes");
  return {.added = given.added,
          .removed = given.removed,
          .capacity = given.capacity,
          .counts = given.counts,
          .added_offsets = given.added_offsets,
          .removed_offsets = given.removed_offsets};
}

broadcl_pair_buffer to_c(const DeviceBroadPhase::PairBuffer& pairs) noexcept {
  return {pairs.buffer, pairs.count, pairs.offsets};
}

broadcl_device_result to_c(const DeviceBroadPhase::Result& result) noexcept {
  return {.size = sizeof(broadcl_device_result),
          .added = to_c(result.added),
          .removed = to_c(result.removed),
          .pair_count = result.pair_count,
          .invalid_boxes = result.invalid_boxes,
          .first_invalid = result.first_invalid.value_or(0),
          .incomplete = result.incomplete};
}

/// The result of an update, if the caller wants it.
template <class Function>
void update(broadcl_device_result* result, const Function& function) {
  if (result == nullptr) {
    function();
  } else {
    const c::Out out(result, "result");
    out.write(to_c(function()));
  }
}

}  // namespace

broadcl_status broadcl_device_broad_phase_create(cl_command_queue queue, const broadcl_device_config* config,
                                                 broadcl_device_broad_phase** broad_phase) {
  return c::call(__func__, [&] {
    c::required(broad_phase, "broad_phase");
    c::required(queue, "queue");
    *broad_phase = new broadcl_device_broad_phase{.broad_phase = DeviceBroadPhase(queue, to_config(config))};
  });
}

broadcl_status broadcl_device_broad_phase_destroy(broadcl_device_broad_phase* broad_phase) {
  return c::call(__func__, [&] { delete broad_phase; });
}

broadcl_status broadcl_device_broad_phase_update(broadcl_device_broad_phase* broad_phase,
                                                 const broadcl_device_boxes* boxes,
                                                 broadcl_device_result* result) {
  return c::call(__func__,
                 [&] { update(result, [&] { return object(broad_phase).update(to_boxes(boxes)); }); });
}

broadcl_status broadcl_device_broad_phase_begin(broadcl_device_broad_phase* broad_phase,
                                                const broadcl_device_boxes* boxes) {
  return c::call(__func__, [&] { object(broad_phase).begin(to_boxes(boxes)); });
}

broadcl_status broadcl_device_broad_phase_finish(broadcl_device_broad_phase* broad_phase,
                                                 broadcl_device_result* result) {
  return c::call(__func__, [&] { update(result, [&] { return object(broad_phase).finish(); }); });
}

broadcl_status broadcl_device_broad_phase_reserve(broadcl_device_broad_phase* broad_phase, std::size_t boxes,
                                                  std::size_t pairs, int filters) {
  return c::call(__func__, [&] { object(broad_phase).reserve(boxes, pairs, filters != 0); });
}

broadcl_status broadcl_device_broad_phase_shrink(broadcl_device_broad_phase* broad_phase) {
  return c::call(__func__, [&] { object(broad_phase).shrink(); });
}

broadcl_status broadcl_device_broad_phase_set_exclusions(broadcl_device_broad_phase* broad_phase,
                                                         const broadcl_pair* pairs, std::size_t count) {
  return c::call(__func__, [&] { object(broad_phase).set_exclusions(c::to_pairs(pairs, count, "pairs")); });
}

broadcl_status broadcl_device_broad_phase_enqueue(broadcl_device_broad_phase* broad_phase,
                                                  const broadcl_device_boxes* boxes,
                                                  const broadcl_change_buffers* changes) {
  return c::call(__func__, [&] { object(broad_phase).enqueue(to_boxes(boxes), to_changes(changes)); });
}

broadcl_status broadcl_device_broad_phase_pairs(broadcl_device_broad_phase* broad_phase,
                                                broadcl_pair_buffer* pairs) {
  return c::call(__func__, [&] {
    c::required(pairs, "pairs");
    *pairs = to_c(object(broad_phase).pairs());
  });
}

broadcl_status broadcl_device_broad_phase_device(const broadcl_device_broad_phase* broad_phase,
                                                 broadcl_device_info* info) {
  return c::call(__func__, [&] {
    const c::Out out(info, "info");
    out.write(c::required(broad_phase, "broad_phase").device.info());
  });
}

broadcl_status broadcl_device_broad_phase_memory(const broadcl_device_broad_phase* broad_phase,
                                                 broadcl_memory_use* use) {
  return c::call(__func__, [&] {
    const c::Out out(use, "use");
    out.write(c::to_c(c::required(broad_phase, "broad_phase").broad_phase.memory()));
  });
}

broadcl_status broadcl_device_broad_phase_profile(broadcl_device_broad_phase* broad_phase,
                                                  const broadcl_stage** stages, std::size_t* count) {
  return c::call(__func__, [&] {
    c::required(stages, "stages");
    c::required(count, "count");
    broadcl_device_broad_phase& handle = c::required(broad_phase, "broad_phase");
    handle.stages = c::to_c(handle.broad_phase.profile());
    *stages = handle.stages.data();
    *count = handle.stages.size();
  });
}
