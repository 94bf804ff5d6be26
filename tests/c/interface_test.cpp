#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <thread>
#include <type_traits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "c_test.hpp"

namespace broadcl::test {
namespace {

using ::testing::StartsWith;

TEST(C, TheLibraryIsAsOldAsItsHeader) {
  EXPECT_EQ(broadcl_version(), static_cast<std::uint32_t>(BROADCL_VERSION_NUMBER));
  EXPECT_EQ(std::to_string(BROADCL_VERSION_MAJOR) + "." + std::to_string(BROADCL_VERSION_MINOR) + "." +
                std::to_string(BROADCL_VERSION_PATCH),
            BROADCL_VERSION_STRING);
}

TEST(C, TheLastErrorIsOfItsThreadAndStays) {
  EXPECT_INVALID("list is null", broadcl_device_list_create, nullptr);
  std::thread other([] {
    EXPECT_STREQ(broadcl_last_error(), "");
    EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_remove, nullptr, nullptr, 0);
  });
  other.join();
  const broadcl_algorithm* rows = nullptr;
  std::size_t count = 0;
  OK(broadcl_algorithms(&rows, &count));
  EXPECT_STREQ(broadcl_last_error(), "broadcl_device_list_create: list is null; it must not be");
}

TEST(C, DestroyingNothingIsANoOp) {
  OK(broadcl_device_list_destroy(nullptr));
  OK(broadcl_pair_list_destroy(nullptr));
  OK(broadcl_hit_list_destroy(nullptr));
  OK(broadcl_broad_phase_destroy(nullptr));
  OK(broadcl_device_broad_phase_destroy(nullptr));
}

TEST(C, NullHandlesAreRefused) {
  const broadcl_filter filter = BROADCL_DEFAULT_FILTER;
  const broadcl_boxes boxes = view({});
  auto info = sized<broadcl_device_info>();
  auto use = sized<broadcl_memory_use>();
  const auto device_boxes = sized<broadcl_device_boxes>();
  const auto changes = sized<broadcl_change_buffers>();
  auto result = sized<broadcl_device_result>();
  broadcl_pairs pairs{};
  broadcl_hits hits{};
  broadcl_hit_list* found = nullptr;
  const std::uint32_t* ids = nullptr;
  double reach = 0;
  broadcl_pair_buffer buffer{};
  broadcl_aabb* mapped = nullptr;
  int contains = 0;
  broadcl_aabb of_object{};
  broadcl_filter filter_of_object{};
  const broadcl_aabb* all_boxes = nullptr;
  const broadcl_aabb64* all_boxes64 = nullptr;
  const broadcl_filter* all_filters = nullptr;
  const double* all_reaches = nullptr;
  const broadcl_algorithm* row = nullptr;
  const broadcl_stage* stages = nullptr;
  const char* line = nullptr;
  const void* bytes = nullptr;
  std::size_t n = 0;
  std::uint32_t id = 0;
  EXPECT_INVALID("list is null", broadcl_device_list_size, nullptr, &n);
  EXPECT_INVALID("list is null", broadcl_device_list_get, nullptr, 0, &info);
  EXPECT_INVALID("list is null", broadcl_device_list_failure_count, nullptr, &n);
  EXPECT_INVALID("list is null", broadcl_device_list_failure, nullptr, 0, &line);
  EXPECT_INVALID("list is null", broadcl_device_list_select, nullptr, "cpu", &n);
  EXPECT_INVALID("list is null", broadcl_pair_list_pairs, nullptr, &pairs);
  EXPECT_INVALID("list is null", broadcl_hit_list_hits, nullptr, &hits);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_filter, nullptr, 0, &filter);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_map, nullptr, 0, &mapped);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_update_boxes, nullptr, &boxes, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_begin_boxes, nullptr, &boxes);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_add, nullptr, &boxes, nullptr, 0, &id);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_move, nullptr, &id, 1, &boxes);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_remove, nullptr, &id, 1);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_contains, nullptr, 0, &contains);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_box, nullptr, 0, &of_object);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_filter, nullptr, 0, &filter_of_object);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_reach, nullptr, &id, 1, &reach, 1);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_reach, nullptr, 0, &reach);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_filters, nullptr, &id, 1, &filter, 1);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_ids, nullptr, &ids, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_boxes, nullptr, &all_boxes, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_boxes64, nullptr, &all_boxes64, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_filters, nullptr, &all_filters, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_reaches, nullptr, &all_reaches, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_exclusions, nullptr, &pairs);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_partners, nullptr, 0, &ids, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_save, nullptr, &bytes, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_restore, nullptr, &n, 1, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_overlapping, nullptr, &boxes, nullptr, &found);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_nearest, nullptr, &boxes, nullptr, &found);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_along, nullptr, &boxes, nullptr, 0, nullptr, 0,
                 nullptr, &found);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_update, nullptr, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_begin, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_finish, nullptr, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_pairs, nullptr, &pairs);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_size, nullptr, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_device, nullptr, &info);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_algorithm, nullptr, &row);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_memory, nullptr, &use);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_profile, nullptr, &stages, &n);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_update, nullptr, &device_boxes, &result);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_begin, nullptr, &device_boxes);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_finish, nullptr, &result);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_reserve, nullptr, 1, 1, 0);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_set_exclusions, nullptr, nullptr, 0);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_enqueue, nullptr, &device_boxes, &changes);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_pairs, nullptr, &buffer);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_device, nullptr, &info);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_memory, nullptr, &use);
  EXPECT_INVALID("broad_phase is null", broadcl_device_broad_phase_profile, nullptr, &stages, &n);
}

TEST(C, StructsMayBeOlderOrNewerThanTheLibrary) {
  struct Newer {
    broadcl_config known;
    std::size_t unknown;
  } newer{};
  static_assert(std::is_standard_layout_v<Newer>);
  broadcl_broad_phase* handle = nullptr;
  newer.known.algorithm = "oracle";
  for (const std::size_t size :
       {std::size_t{0}, sizeof(std::size_t), sizeof(broadcl_config) - 1, SIZE_MAX - 7}) {
    newer.known.size = size;
    EXPECT_INVALID("config->size is " + std::to_string(size), broadcl_broad_phase_create, &newer.known,
                   &handle);
  }
  newer.known.size = sizeof newer;
  newer.unknown = 1;
  EXPECT_INVALID("too old", broadcl_broad_phase_create, &newer.known, &handle);
  EXPECT_EQ(handle, nullptr);
  newer.unknown = 0;
  OK(broadcl_broad_phase_create(&newer.known, &handle));
  OK(broadcl_broad_phase_destroy(handle));

  // As if `algorithm` had come in a later version: it is not read.
  auto older = on_host("frobnicate");
  EXPECT_INVALID("frobnicate", broadcl_broad_phase_create, &older, &handle);
  older.size = offsetof(broadcl_config, algorithm);
  OK(broadcl_broad_phase_create(&older, &handle));
  OK(broadcl_broad_phase_destroy(handle));

  struct NewerUse {
    broadcl_memory_use known;
    std::size_t unknown;
  } use{};
  const broadcl_config config = on_host();
  OK(broadcl_broad_phase_create(&config, &handle));
  use.known = {.size = sizeof use, .device = 77, .device_peak = 77, .pinned = 77};
  use.unknown = 77;
  OK(broadcl_broad_phase_memory(handle, &use.known));
  EXPECT_EQ(use.known.size, sizeof use);
  EXPECT_EQ(use.known.pinned, 0U);
  EXPECT_EQ(use.unknown, 0U);
  use.known = {.size = offsetof(broadcl_memory_use, pinned), .device = 77, .device_peak = 77, .pinned = 77};
  OK(broadcl_broad_phase_memory(handle, &use.known));
  EXPECT_EQ(use.known.device, 0U);
  EXPECT_EQ(use.known.pinned, 77U);
  use.known.size = std::size_t{1} << 40U;
  EXPECT_INVALID("use->size is 1099511627776", broadcl_broad_phase_memory, handle, &use.known);
  use.known.size = 0;
  EXPECT_INVALID("use->size is 0", broadcl_broad_phase_memory, handle, &use.known);
  OK(broadcl_broad_phase_destroy(handle));
}

TEST(C, AlgorithmsAreListed) {
  const broadcl_algorithm* rows = nullptr;
  std::size_t count = 0;
  OK(broadcl_algorithms(&rows, &count));
  std::map<std::string, int> on_device;
  for (std::size_t k = 0; k < count; ++k) {
    on_device[rows[k].name] = rows[k].on_device;
    EXPECT_NE(std::strlen(rows[k].summary), 0U);
  }
  EXPECT_EQ(on_device.at("tiles"), 1);
  EXPECT_EQ(on_device.at("oracle"), 0);
}

TEST(C, DevicesAreListed) {
  broadcl_device_list* devices = nullptr;
  OK(broadcl_device_list_create(&devices));
  std::size_t count = 0;
  OK(broadcl_device_list_size(devices, &count));
  ASSERT_GE(count, 1U);
  for (std::size_t k = 0; k < count; ++k) {
    auto info = sized<broadcl_device_info>();
    OK(broadcl_device_list_get(devices, k, &info));
    EXPECT_EQ(std::string(info.label), std::string(info.platform_name) + " / " + info.name);
    EXPECT_THAT(info.version, StartsWith("OpenCL "));
    EXPECT_NE(std::strlen(info.driver_version), 0U);
    static_assert(std::is_same_v<decltype(info.type), std::int32_t>, "an enum's width may differ");
    EXPECT_GE(info.type, BROADCL_GPU);
    EXPECT_LE(info.type, BROADCL_OTHER_DEVICE);
    EXPECT_GE(info.compute_units, 1U);
    EXPECT_GE(info.memory, info.max_allocation);
    EXPECT_GT(info.max_allocation, 0U);
    EXPECT_TRUE(info.host_unified == 0 || info.host_unified == 1);
    std::size_t index = 77;
    OK(broadcl_device_list_select(devices, info.id, &index));
    EXPECT_EQ(index, k);
  }
  std::size_t chosen = 77;
  OK(broadcl_device_list_select(devices, nullptr, &chosen));
  EXPECT_LT(chosen, count);
  EXPECT_FAILED("frobnicate", broadcl_device_list_select, devices, "frobnicate", &chosen);
  auto info = sized<broadcl_device_info>();
  EXPECT_INVALID("index is " + std::to_string(count), broadcl_device_list_get, devices, count, &info);
  EXPECT_INVALID("info is null", broadcl_device_list_get, devices, 0, nullptr);
  EXPECT_INVALID("index is null", broadcl_device_list_select, devices, "", nullptr);
  std::size_t failures = 77;
  OK(broadcl_device_list_failure_count(devices, &failures));
  const char* line = nullptr;
  for (std::size_t k = 0; k < failures; ++k) OK(broadcl_device_list_failure(devices, k, &line));
  EXPECT_INVALID("index is", broadcl_device_list_failure, devices, failures, &line);
  EXPECT_INVALID("line is null", broadcl_device_list_failure, devices, 0, nullptr);
  EXPECT_INVALID("size is null", broadcl_device_list_size, devices, nullptr);
  EXPECT_INVALID("count is null", broadcl_device_list_failure_count, devices, nullptr);
  OK(broadcl_device_list_destroy(devices));
}

}  // namespace
}  // namespace broadcl::test
