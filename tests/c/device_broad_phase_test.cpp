#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "../forked_child.hpp"
#include "c_test.hpp"

namespace broadcl::test {
namespace {

using ::testing::ElementsAre;

/// A caller with a queue of his own, on the default device.
class COnDevice : public testing::Test {
 protected:
  void SetUp() override {
    broadcl_device_list* devices = nullptr;
    OK(broadcl_device_list_create(&devices));
    std::size_t index = 0;
    OK(broadcl_device_list_select(devices, "", &index));
    auto info = sized<broadcl_device_info>();
    OK(broadcl_device_list_get(devices, index, &info));
    id_ = info.id;
    OK(broadcl_device_list_destroy(devices));

    const std::size_t colon = id_.find(':');
    const auto platform_index = std::stoul(id_.substr(0, colon));
    const auto device_index = std::stoul(id_.substr(colon + 1));
    std::vector<cl_platform_id> platforms(platform_index + 1);
    ASSERT_EQ(clGetPlatformIDs(static_cast<cl_uint>(platforms.size()), platforms.data(), nullptr),
              CL_SUCCESS);
    std::vector<cl_device_id> all(device_index + 1);
    ASSERT_EQ(clGetDeviceIDs(platforms.back(), CL_DEVICE_TYPE_ALL, static_cast<cl_uint>(all.size()),
                             all.data(), nullptr),
              CL_SUCCESS);
    context_ = clCreateContext(nullptr, 1, &all.back(), nullptr, nullptr, nullptr);
    queue_ = clCreateCommandQueue(context_, all.back(), CL_QUEUE_PROFILING_ENABLE, nullptr);
    ASSERT_NE(queue_, nullptr);
    auto config = sized<broadcl_device_config>();
    config.algorithm = "brute-force";
    config.profile = 1;
    OK(broadcl_device_broad_phase_create(queue_, &config, &handle_));
  }

  void TearDown() override {
    clFinish(queue_);
    OK(broadcl_device_broad_phase_destroy(handle_));
    for (cl_mem buffer : buffers_) clReleaseMemObject(buffer);
    clReleaseCommandQueue(queue_);
    clReleaseContext(context_);
  }

  template <class T>
  cl_mem buffer_of(std::vector<T> values) {
    buffers_.push_back(clCreateBuffer(context_, CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR,
                                      values.size() * sizeof(T), values.data(), nullptr));
    return buffers_.back();
  }

  template <class T>
  std::vector<T> read(cl_mem buffer, std::size_t count) {
    std::vector<T> values(count);
    if (count > 0) {
      EXPECT_EQ(clEnqueueReadBuffer(queue_, buffer, CL_TRUE, 0, count * sizeof(T), values.data(), 0, nullptr,
                                    nullptr),
                CL_SUCCESS);
    }
    return values;
  }
  Pairs read(const broadcl_pair_buffer& pairs) { return read<broadcl_pair>(pairs.buffer, pairs.count); }

  broadcl_device_boxes give(const std::vector<broadcl_aabb>& boxes) {
    auto result = sized<broadcl_device_boxes>();
    result.buffer = buffer_of(boxes);
    result.count = boxes.size();
    return result;
  }

  std::string id_;
  cl_context context_ = nullptr;
  cl_command_queue queue_ = nullptr;
  broadcl_device_broad_phase* handle_ = nullptr;
  std::vector<cl_mem> buffers_;
};

TEST_F(COnDevice, ShrinksBetweenUpdates) {
  const broadcl_device_boxes given = give(std::vector<broadcl_aabb>(3, cube(0)));
  auto result = sized<broadcl_device_result>();
  OK(broadcl_device_broad_phase_reserve(handle_, 1000, 100'000, 1));
  OK(broadcl_device_broad_phase_begin(handle_, &given));
  EXPECT_FAILED("finish", broadcl_device_broad_phase_shrink, handle_);
  OK(broadcl_device_broad_phase_finish(handle_, &result));
  auto before = sized<broadcl_memory_use>();
  OK(broadcl_device_broad_phase_memory(handle_, &before));
  OK(broadcl_device_broad_phase_shrink(handle_));
  broadcl_pair_buffer pairs{};
  OK(broadcl_device_broad_phase_pairs(handle_, &pairs));
  EXPECT_THAT(read(pairs), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{0, 2}, broadcl_pair{1, 2}));
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_EQ(result.added.count + result.removed.count, 0U);
  EXPECT_EQ(result.pair_count, 3U);
  auto after = sized<broadcl_memory_use>();
  OK(broadcl_device_broad_phase_memory(handle_, &after));
  EXPECT_LT(after.device, before.device / 2);
}

TEST_F(COnDevice, CanOnlyBeDestroyedInAForkedChild) {
  const broadcl_device_boxes given = give({cube(0), cube(1)});
  OK(broadcl_device_broad_phase_update(handle_, &given, nullptr));
  EXPECT_TRUE(holds_in_child([&] {
    EXPECT_FAILED("after a fork", broadcl_device_broad_phase_update, handle_, &given, nullptr);
    OK(broadcl_device_broad_phase_destroy(handle_));
    broadcl_device_list* devices = nullptr;
    EXPECT_FAILED("after a fork", broadcl_device_list_create, &devices);
    broadcl_broad_phase* broad_phase = nullptr;
    const broadcl_config on_device = on_host("tiles");
    EXPECT_FAILED("after a fork", broadcl_broad_phase_create, &on_device, &broad_phase);
    OK(broadcl_broad_phase_create(nullptr, &broad_phase));
    OK(broadcl_broad_phase_destroy(broad_phase));
  }));
}

TEST_F(COnDevice, FindsPairsAndChanges) {
  std::vector<broadcl_aabb> boxes = random_boxes(200);
  const Pairs first = overlapping(boxes);
  auto result = sized<broadcl_device_result>();
  broadcl_device_boxes given = give(boxes);
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_EQ(read(result.added), first);
  EXPECT_EQ(result.removed.count, 0U);
  EXPECT_EQ(result.pair_count, first.size());
  EXPECT_EQ(result.added.offsets, nullptr);

  // The same boxes with a gap between them and before the first, one of them invalid, and a filter each.
  std::vector<std::array<float, 8>> apart(boxes.size() + 1);
  boxes[9] = cube(nan_value);
  for (std::size_t k = 0; k < boxes.size(); ++k) std::memcpy(apart[k + 1].data(), &boxes[k], sizeof boxes[k]);
  std::vector<broadcl_filter> filters(boxes.size(), broadcl_filter BROADCL_DEFAULT_FILTER);
  filters[12].mask = 0;
  given.buffer = buffer_of(apart);
  given.offset = given.stride = sizeof apart[0];
  given.filters = buffer_of(filters);
  Pairs expected;
  Pairs removed;
  for (const broadcl_pair& pair : first) {
    const bool stays = pair.a != 9 && pair.b != 9 && pair.a != 12 && pair.b != 12;
    (stays ? expected : removed).push_back(pair);
  }
  OK(broadcl_device_broad_phase_begin(handle_, &given));
  EXPECT_FAILED("finish", broadcl_device_broad_phase_begin, handle_, &given);
  OK(broadcl_device_broad_phase_finish(handle_, &result));
  EXPECT_EQ(read(result.removed), removed);
  EXPECT_EQ(result.invalid_boxes, 1U);
  EXPECT_EQ(result.first_invalid, 9U);
  broadcl_pair_buffer all{};
  OK(broadcl_device_broad_phase_pairs(handle_, &all));
  EXPECT_EQ(read(all), expected);
  EXPECT_FAILED("begin()", broadcl_device_broad_phase_finish, handle_, &result);

  const broadcl_stage* stages = nullptr;
  std::size_t count = 0;
  OK(broadcl_device_broad_phase_profile(handle_, &stages, &count));
  double device_seconds = 0;
  for (std::size_t k = 0; k < count; ++k) device_seconds += stages[k].device_seconds;
  EXPECT_GT(device_seconds, 0);
  auto use = sized<broadcl_memory_use>();
  OK(broadcl_device_broad_phase_memory(handle_, &use));
  EXPECT_GT(use.device, 0U);
  EXPECT_GE(use.device_peak, use.device);
  auto info = sized<broadcl_device_info>();
  OK(broadcl_device_broad_phase_device(handle_, &info));
  EXPECT_EQ(info.id, id_);
}

TEST_F(COnDevice, FindsPairsOfTwoSets) {
  const std::vector<broadcl_aabb> boxes = random_boxes(150);
  constexpr std::uint32_t split = 60;
  Pairs expected;
  for (const broadcl_pair& pair : overlapping(boxes)) {
    if (pair.a < split && pair.b >= split) expected.push_back({pair.a, pair.b - split});
  }
  broadcl_device_boxes given = give(boxes);
  given.count = split;
  std::vector<std::array<float, 8>> apart(boxes.size() - split + 1);
  for (std::size_t k = split; k < boxes.size(); ++k) {
    std::memcpy(apart[k - split + 1].data(), &boxes[k], sizeof boxes[k]);
  }
  given.second_buffer = buffer_of(apart);
  given.second_count = boxes.size() - split;
  given.second_offset = given.second_stride = sizeof apart[0];
  auto result = sized<broadcl_device_result>();
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_EQ(read(result.added), expected);
}

TEST_F(COnDevice, EnqueuesWithoutWaiting) {
  const std::vector<broadcl_aabb> boxes = random_boxes(50);
  const Pairs expected = overlapping(boxes);
  std::vector<broadcl_filter> filters(boxes.size(), broadcl_filter BROADCL_DEFAULT_FILTER);
  broadcl_device_boxes given = give(boxes);
  given.filters = buffer_of(filters);
  given.worlds = 1;
  given.ordered_worlds = 2;
  auto changes = sized<broadcl_change_buffers>();
  changes.capacity = 1000;
  changes.added = buffer_of(Pairs(changes.capacity));
  changes.removed = buffer_of(Pairs(changes.capacity));
  changes.counts = buffer_of(std::vector<std::uint32_t>(4));
  changes.added_offsets = buffer_of(std::vector<std::uint32_t>(4));
  changes.removed_offsets = buffer_of(std::vector<std::uint32_t>(4));
  EXPECT_INVALID("reserve()", broadcl_device_broad_phase_enqueue, handle_, &given, &changes);
  OK(broadcl_device_broad_phase_reserve(handle_, boxes.size(), changes.capacity, 1));
  OK(broadcl_device_broad_phase_enqueue(handle_, &given, &changes));
  const auto size = static_cast<std::uint32_t>(expected.size());
  EXPECT_THAT(read<std::uint32_t>(changes.counts, 4), ElementsAre(size, 0U, size, 0U));
  EXPECT_EQ(read<broadcl_pair>(changes.added, size), expected);
  EXPECT_THAT(read<std::uint32_t>(changes.added_offsets, 4), ElementsAre(0U, size, size, size));
  EXPECT_THAT(read<std::uint32_t>(changes.removed_offsets, 4), ElementsAre(0U, 0U, 0U, 0U));

  changes.capacity = 1;
  given.count = 1;
  OK(broadcl_device_broad_phase_enqueue(handle_, &given, &changes));
  auto result = sized<broadcl_device_result>();
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_EQ(result.incomplete, 1U);
  EXPECT_EQ(result.removed.count, expected.size());
}

TEST_F(COnDevice, RefusesWhatItCannotUse) {
  broadcl_device_broad_phase* other = nullptr;
  EXPECT_INVALID("queue is null", broadcl_device_broad_phase_create, nullptr, nullptr, &other);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_create, queue_, nullptr, nullptr);
  auto config = sized<broadcl_device_config>();
  config.algorithm = "oracle";
  EXPECT_INVALID("oracle", broadcl_device_broad_phase_create, queue_, &config, &other);
  config.size = 0;
  EXPECT_INVALID("config->size is 0", broadcl_device_broad_phase_create, queue_, &config, &other);
  EXPECT_EQ(other, nullptr);
  broadcl_device_boxes given = give({cube(0), cube(1)});
  given.count = 3;
  EXPECT_INVALID("too few", broadcl_device_broad_phase_update, handle_, &given, nullptr);
  given.count = 2;
  auto result = sized<broadcl_device_result>();
  result.size = 0;
  EXPECT_INVALID("result->size is 0", broadcl_device_broad_phase_update, handle_, &given, &result);
  EXPECT_INVALID("boxes is null", broadcl_device_broad_phase_update, handle_, nullptr, nullptr);
  EXPECT_INVALID("changes is null", broadcl_device_broad_phase_enqueue, handle_, &given, nullptr);
  EXPECT_INVALID("pairs is null", broadcl_device_broad_phase_pairs, handle_, nullptr);
  EXPECT_INVALID("info is null", broadcl_device_broad_phase_device, handle_, nullptr);
  EXPECT_INVALID("use is null", broadcl_device_broad_phase_memory, handle_, nullptr);
  const broadcl_stage* stages = nullptr;
  std::size_t count = 0;
  EXPECT_INVALID("stages is null", broadcl_device_broad_phase_profile, handle_, nullptr, &count);
  EXPECT_INVALID("count is null", broadcl_device_broad_phase_profile, handle_, &stages, nullptr);
  OK(broadcl_device_broad_phase_update(handle_, &given, nullptr));
}

TEST_F(COnDevice, ABroadPhaseOnADeviceSaysThatItCompiles) {
  struct Heard {
    int times = 0;
    std::string label;
    std::string cache_folder = "unchanged";
  } heard;
  auto config = sized<broadcl_config>();
  config.device = id_.c_str();
  config.algorithm = "brute-force";
  config.profile = 1;
  config.on_compile = [](const broadcl_device_info* device, const char* cache_folder, void* data) {
    auto& hears = *static_cast<Heard*>(data);
    ++hears.times;
    hears.label = device->label;
    hears.cache_folder = cache_folder;
  };
  config.on_compile_data = &heard;
  ASSERT_EQ(setenv("BROADCL_CACHE_DIR", "/dev/null", 1), 0);
  broadcl_broad_phase* handle = nullptr;
  OK(broadcl_broad_phase_create(&config, &handle));
  auto info = sized<broadcl_device_info>();
  OK(broadcl_broad_phase_device(handle, &info));
  EXPECT_EQ(info.id, id_);
  EXPECT_EQ(heard.times, 1);
  EXPECT_EQ(heard.label, info.label);
  EXPECT_EQ(heard.cache_folder, "");
  const std::vector<broadcl_aabb> boxes = random_boxes(60);
  const broadcl_boxes given = view(boxes);
  broadcl_delta delta{};
  OK(broadcl_broad_phase_update_boxes(handle, &given, &delta));
  EXPECT_EQ(list(delta.added), overlapping(boxes));
  const broadcl_stage* stages = nullptr;
  std::size_t count = 0;
  OK(broadcl_broad_phase_profile(handle, &stages, &count));
  std::map<std::string, double> seconds;
  for (std::size_t k = 0; k < count; ++k) {
    EXPECT_GE(stages[k].host_start, 0);
    seconds[stages[k].name] += stages[k].host_seconds;
  }
  EXPECT_GT(seconds["test"], 0);
  OK(broadcl_broad_phase_update(handle, nullptr));
  OK(broadcl_broad_phase_profile(handle, &stages, &count));
  EXPECT_EQ(count, 0U) << "nothing had moved";
  auto use = sized<broadcl_memory_use>();
  OK(broadcl_broad_phase_memory(handle, &use));
  EXPECT_GT(use.device, 0U);
  OK(broadcl_broad_phase_destroy(handle));
}

}  // namespace
}  // namespace broadcl::test
