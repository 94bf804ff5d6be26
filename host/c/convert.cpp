#include "c/convert.hpp"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "c/call.hpp"

namespace broadcl::c {
namespace {

template <Bound S>
BoxView view_of(const broadcl_boxes& boxes) {
  const bool is_flat = boxes.dimensions == 2;
  const auto* numbers = static_cast<const S*>(boxes.data);
  return is_flat ? BoxView::rectangles(numbers, boxes.count, boxes.stride)
                 : BoxView::interleaved(numbers, boxes.count, boxes.stride);
}

Executor to_executor(broadcl_executor executor, void* data) {
  if (executor == nullptr) return {};
  return [executor, data](std::function<void()> task) {
    using Task = std::function<void()>;
    executor([](void* given) { (*std::unique_ptr<Task>(static_cast<Task*>(given)))(); },
             new Task(std::move(task)), data);
  };
}

}  // namespace

BoxView to_view(const broadcl_boxes* boxes, const char* name) {
  const broadcl_boxes given = read(boxes, name);
  if (given.dimensions == 1 || given.dimensions > 3) {
    throw Error::invalid_argument(std::string(name) + "->dimensions is " + std::to_string(given.dimensions) +
                                  "; give 2 or 3");
  }
  try {
    switch (given.type) {
      case BROADCL_FLOAT32:
        return view_of<float>(given);
      case BROADCL_FLOAT64:
        return view_of<double>(given);
    }
  } catch (const Error& error) {
    throw Error(std::string(name) + ": " + error.what(), error.kind());
  }
  throw Error::invalid_argument(std::string(name) + "->type is " + std::to_string(given.type) +
                                "; give BROADCL_FLOAT32 or BROADCL_FLOAT64");
}

std::span<const Pair> to_pairs(const broadcl_pair* pairs, std::size_t count, const char* name) {
  const std::span<const broadcl_pair> given = array(pairs, count, name);
  return {reinterpret_cast<const Pair*>(given.data()), given.size()};
}

std::span<const Filter> to_filters(const broadcl_filter* filters, std::size_t count, const char* name) {
  static_assert(offsetof(broadcl_filter, group) == offsetof(Filter, group) &&
                offsetof(broadcl_filter, mask) == offsetof(Filter, mask) &&
                offsetof(broadcl_filter, body) == offsetof(Filter, body) &&
                offsetof(broadcl_filter, world) == offsetof(Filter, world));
  const auto given = array(filters, count, name);
  return {reinterpret_cast<const Filter*>(given.data()), given.size()};
}

CompileHandler to_handler(broadcl_compile_handler handler, void* data) {
  if (handler == nullptr) return {};
  return [handler, data](const Device& device, const std::string& cache_folder) {
    const DeviceFacts facts(device);
    const broadcl_device_info info = facts.info();
    handler(&info, cache_folder.c_str(), data);
  };
}

Config to_config(const broadcl_config* config) {
  const broadcl_config given = read_optional(config, "config");
  Config result;
  if (given.device != nullptr) result.device = given.device;
  if (given.algorithm != nullptr) result.algorithm = given.algorithm;
  result.threads = given.threads;
  result.executor = to_executor(given.executor, given.executor_data);
  result.distance = given.distance;
  result.profile = given.profile != 0;
  result.on_compile = to_handler(given.on_compile, given.on_compile_data);
  return result;
}

QueryOptions to_options(const broadcl_query_options* options) {
  const broadcl_query_options given = read_optional(options, "options");
  QueryOptions result{.filters = to_filters(given.filters, given.filter_count, "options->filters"),
                      .except = array(given.except, given.except_count, "options->except"),
                      .count_only = given.count_only != 0};
  if (given.limit != 0) result.limit = given.limit;
  if (given.most_hits != 0) result.most_hits = given.most_hits;
  if (given.within != 0) result.within = given.within;
  return result;
}

bool is_float64(const broadcl_config* config) {
  const std::int32_t type = read_optional(config, "config").type;
  if (type == BROADCL_FLOAT32 || type == BROADCL_FLOAT64) return type == BROADCL_FLOAT64;
  throw Error::invalid_argument("config->type is " + std::to_string(type) +
                                "; give BROADCL_FLOAT32 or BROADCL_FLOAT64");
}

DeviceFacts::DeviceFacts(Device device)
    : device_(std::move(device)), id_(device_.id()), label_(device_.label()) {}

broadcl_device_info DeviceFacts::info() const noexcept {
  return {.size = sizeof(broadcl_device_info),
          .id = id_.c_str(),
          .label = label_.c_str(),
          .platform_name = device_.platform_name.c_str(),
          .name = device_.name.c_str(),
          .version = device_.version.c_str(),
          .driver_version = device_.driver_version.c_str(),
          .type = static_cast<std::int32_t>(device_.type),
          .compute_units = device_.compute_units,
          .clock_mhz = device_.clock_mhz,
          .vendor_id = device_.vendor_id,
          .memory = device_.memory,
          .max_allocation = device_.max_allocation,
          .host_unified = device_.host_unified ? 1 : 0};
}
static_assert(static_cast<int>(DeviceType::gpu) == BROADCL_GPU &&
              static_cast<int>(DeviceType::cpu) == BROADCL_CPU &&
              static_cast<int>(DeviceType::accelerator) == BROADCL_ACCELERATOR &&
              static_cast<int>(DeviceType::other) == BROADCL_OTHER_DEVICE);

std::vector<broadcl_stage> to_c(std::span<const Stage> stages) {
  std::vector<broadcl_stage> result;
  result.reserve(stages.size());
  for (const Stage& stage : stages) {  // names are literals, so they end with a zero
    result.push_back(
        {stage.name.data(), stage.host_start, stage.host_seconds, stage.device_start, stage.device_seconds});
  }
  return result;
}

std::span<const broadcl_algorithm> rows() {
  static const std::vector<broadcl_algorithm> table = [] {
    std::vector<broadcl_algorithm> result;
    for (const AlgorithmInfo& row : algorithms()) {  // literals, too
      result.push_back({row.name.data(), row.summary.data(), row.on_device ? 1 : 0});
    }
    return result;
  }();
  return table;
}

const broadcl_algorithm& row_of(const AlgorithmInfo& algorithm) {
  const std::span<const AlgorithmInfo> table = algorithms();
  const auto row = std::ranges::find(table, algorithm.name, &AlgorithmInfo::name);
  return rows()[static_cast<std::size_t>(row - table.begin())];
}

}  // namespace broadcl::c
