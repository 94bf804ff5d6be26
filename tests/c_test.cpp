// The C interface, and nothing else of the library: linked against the shared one, if that is built.
#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>
#include <broadcl/broadcl.h>
#include <sys/resource.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <ostream>
#include <random>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

bool operator==(const broadcl_pair& s, const broadcl_pair& t) {
  return s.a == t.a && s.b == t.b;
}
std::ostream& operator<<(std::ostream& stream, const broadcl_pair& pair) {
  return stream << "(" << pair.a << ", " << pair.b << ")";
}

namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

using Pairs = std::vector<broadcl_pair>;

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();

/// A struct that begins with its size, all default.
template <class Struct>
Struct sized() {
  Struct result{};
  result.size = sizeof(Struct);
  return result;
}

broadcl_config on_host(const char* algorithm = "sweep-and-prune") {
  auto config = sized<broadcl_config>();
  config.algorithm = algorithm;
  return config;
}

broadcl_aabb cube(float x) {
  return {{x, 0, 0}, {x + 1, 1, 1}};
}

broadcl_boxes view(const std::vector<broadcl_aabb>& boxes) {
  auto result = sized<broadcl_boxes>();
  result.data = boxes.data();
  result.count = boxes.size();
  return result;
}

Pairs list(const broadcl_pairs& pairs) {
  return {pairs.data, pairs.data + pairs.count};
}

std::vector<broadcl_aabb> random_boxes(std::size_t n) {
  std::mt19937 random(7);
  const auto number = [&] { return static_cast<float>(random() % 1000) / 100; };
  std::vector<broadcl_aabb> boxes(n);
  for (broadcl_aabb& box : boxes) {
    for (int axis = 0; axis < 3; ++axis) {
      box.lower[axis] = number();
      box.upper[axis] = box.lower[axis] + number() / 4;
    }
  }
  return boxes;
}

Pairs overlapping(const std::vector<broadcl_aabb>& boxes) {
  Pairs pairs;
  for (std::uint32_t b = 0; b < boxes.size(); ++b) {
    for (std::uint32_t a = 0; a < b; ++a) {
      bool overlaps = true;
      for (int axis = 0; axis < 3; ++axis) {
        overlaps = overlaps && boxes[a].lower[axis] <= boxes[b].upper[axis] &&
                   boxes[b].lower[axis] <= boxes[a].upper[axis];
      }
      if (overlaps) pairs.push_back({a, b});
    }
  }
  return pairs;
}

void expect_refused(broadcl_status status, broadcl_status expected, const std::string& function,
                    const std::string& text) {
  EXPECT_EQ(status, expected);
  EXPECT_THAT(broadcl_last_error(), StartsWith(function + ": "));
  EXPECT_THAT(broadcl_last_error(), HasSubstr(text));
}

/// Calls a function whose name its error must begin with.
#define EXPECT_REFUSED(expected, text, function, ...) \
  expect_refused(function(__VA_ARGS__), expected, #function, text)
#define EXPECT_INVALID(text, function, ...) \
  EXPECT_REFUSED(BROADCL_INVALID_ARGUMENT, text, function, __VA_ARGS__)
#define EXPECT_FAILED(text, function, ...) EXPECT_REFUSED(BROADCL_FAILED, text, function, __VA_ARGS__)
#define OK(call) ASSERT_EQ(call, BROADCL_SUCCESS) << broadcl_last_error()

/// A broad phase on the host.
class CBroadPhase : public testing::Test {
 protected:
  void SetUp() override {
    const broadcl_config config = on_host();
    OK(broadcl_broad_phase_create(&config, &handle_));
  }
  void TearDown() override { OK(broadcl_broad_phase_destroy(handle_)); }

  std::uint32_t add(const broadcl_aabb& box, const broadcl_filter* filter = nullptr) {
    std::uint32_t id = 77;
    EXPECT_EQ(broadcl_broad_phase_add(handle_, &box, filter, &id), BROADCL_SUCCESS) << broadcl_last_error();
    return id;
  }
  broadcl_delta update() {
    broadcl_delta delta{};
    EXPECT_EQ(broadcl_broad_phase_update(handle_, &delta), BROADCL_SUCCESS) << broadcl_last_error();
    return delta;
  }

  broadcl_broad_phase* handle_ = nullptr;
};

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
    EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_remove, nullptr, 0);
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
  OK(broadcl_broad_phase_destroy(nullptr));
  OK(broadcl_device_broad_phase_destroy(nullptr));
}

TEST(C, NullHandlesAreRefused) {
  const broadcl_aabb box = cube(0);
  const broadcl_filter filter = BROADCL_DEFAULT_FILTER;
  const broadcl_boxes boxes = view({});
  auto info = sized<broadcl_device_info>();
  auto use = sized<broadcl_memory_use>();
  const auto device_boxes = sized<broadcl_device_boxes>();
  const auto changes = sized<broadcl_change_buffers>();
  auto result = sized<broadcl_device_result>();
  broadcl_pairs pairs{};
  broadcl_pair_buffer buffer{};
  broadcl_aabb* mapped = nullptr;
  const broadcl_algorithm* row = nullptr;
  const broadcl_stage* stages = nullptr;
  const char* line = nullptr;
  std::size_t n = 0;
  std::uint32_t id = 0;
  EXPECT_INVALID("list is null", broadcl_device_list_count, nullptr, &n);
  EXPECT_INVALID("list is null", broadcl_device_list_get, nullptr, 0, &info);
  EXPECT_INVALID("list is null", broadcl_device_list_failure_count, nullptr, &n);
  EXPECT_INVALID("list is null", broadcl_device_list_failure, nullptr, 0, &line);
  EXPECT_INVALID("list is null", broadcl_device_list_select, nullptr, "cpu", &n);
  EXPECT_INVALID("list is null", broadcl_pair_list_get, nullptr, &pairs);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_add, nullptr, &box, nullptr, &id);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_move, nullptr, 0, &box);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_filter, nullptr, 0, &filter);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_remove, nullptr, 0);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_map, nullptr, 0, &mapped);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_boxes, nullptr, &boxes);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_update, nullptr, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_begin, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_finish, nullptr, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_pairs, nullptr, &pairs);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_count, nullptr, &n);
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

TEST_F(CBroadPhase, NullArgumentsAreRefusedAndChangeNothing) {
  const broadcl_aabb box = cube(0);
  const broadcl_boxes boxes = view({box});
  const broadcl_algorithm* rows = nullptr;
  const broadcl_stage* stages = nullptr;
  std::size_t n = 77;
  std::uint32_t id = 77;
  EXPECT_INVALID("id is null", broadcl_broad_phase_add, handle_, &box, nullptr, nullptr);
  EXPECT_INVALID("box is null", broadcl_broad_phase_add, handle_, nullptr, nullptr, &id);
  EXPECT_INVALID("box is null", broadcl_broad_phase_move, handle_, 0, nullptr);
  EXPECT_INVALID("filter is null", broadcl_broad_phase_set_filter, handle_, 0, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_map, handle_, 1, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_set_boxes, handle_, nullptr);
  EXPECT_INVALID("pairs is null", broadcl_broad_phase_pairs, handle_, nullptr);
  EXPECT_INVALID("count is null", broadcl_broad_phase_count, handle_, nullptr);
  EXPECT_INVALID("info is null", broadcl_broad_phase_device, handle_, nullptr);
  EXPECT_INVALID("row is null", broadcl_broad_phase_algorithm, handle_, nullptr);
  EXPECT_INVALID("use is null", broadcl_broad_phase_memory, handle_, nullptr);
  EXPECT_INVALID("stages is null", broadcl_broad_phase_profile, handle_, nullptr, &n);
  EXPECT_INVALID("count is null", broadcl_broad_phase_profile, handle_, &stages, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_create, nullptr, nullptr);
  EXPECT_INVALID("list is null", broadcl_pair_list_create, &boxes, nullptr, nullptr);
  EXPECT_INVALID("rows is null", broadcl_algorithms, nullptr, &n);
  EXPECT_INVALID("count is null", broadcl_algorithms, &rows, nullptr);
  EXPECT_EQ(id, 77U);
  EXPECT_EQ(n, 77U);
  OK(broadcl_broad_phase_count(handle_, &n));
  EXPECT_EQ(n, 0U);
}

TEST(C, StructsMayBeOlderOrNewerThanTheLibrary) {
  struct Newer {
    broadcl_config known;
    std::size_t unknown;
  } newer{};
  static_assert(std::is_standard_layout_v<Newer>);
  broadcl_broad_phase* handle = nullptr;
  newer.known.algorithm = "oracle";
  for (const std::size_t size : {std::size_t{0}, sizeof(std::size_t), sizeof(broadcl_config) - 1}) {
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
  EXPECT_FAILED("frobnicate", broadcl_broad_phase_create, &older, &handle);
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
  OK(broadcl_device_list_count(devices, &count));
  ASSERT_GE(count, 1U);
  for (std::size_t k = 0; k < count; ++k) {
    auto info = sized<broadcl_device_info>();
    OK(broadcl_device_list_get(devices, k, &info));
    EXPECT_EQ(std::string(info.label), std::string(info.platform_name) + " / " + info.name);
    EXPECT_THAT(info.version, StartsWith("OpenCL "));
    EXPECT_NE(std::strlen(info.driver_version), 0U);
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
  EXPECT_INVALID("count is null", broadcl_device_list_count, devices, nullptr);
  EXPECT_INVALID("count is null", broadcl_device_list_failure_count, devices, nullptr);
  OK(broadcl_device_list_destroy(devices));
}

TEST(CPairList, HasAllPairsOfBoxesInAnyLayout) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  const Pairs expected = overlapping(boxes);
  ASSERT_GT(expected.size(), 20U);
  const auto pairs_of = [](const broadcl_boxes& given) {
    const broadcl_config config = on_host();
    broadcl_pair_list* pairs = nullptr;
    EXPECT_EQ(broadcl_pair_list_create(&given, &config, &pairs), BROADCL_SUCCESS) << broadcl_last_error();
    broadcl_pairs found{};
    EXPECT_EQ(broadcl_pair_list_get(pairs, &found), BROADCL_SUCCESS);
    const Pairs result = list(found);
    EXPECT_EQ(broadcl_pair_list_destroy(pairs), BROADCL_SUCCESS);
    return result;
  };
  EXPECT_EQ(pairs_of(view(boxes)), expected);

  std::vector<std::array<float, 8>> apart(boxes.size());
  std::vector<std::array<double, 6>> doubles(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    std::memcpy(apart[k].data(), &boxes[k], sizeof boxes[k]);
    for (std::size_t axis = 0; axis < 6; ++axis) doubles[k].at(axis) = double{apart[k].at(axis)};
  }
  broadcl_boxes given = view(boxes);
  given.data = apart.data();
  given.stride = sizeof apart[0];
  EXPECT_EQ(pairs_of(given), expected);
  given.data = &apart.back();
  given.stride = -given.stride;
  EXPECT_EQ(pairs_of(given).size(), expected.size());
  given = view(boxes);
  given.data = doubles.data();
  given.type = BROADCL_FLOAT64;
  given.dimensions = 3;
  EXPECT_EQ(pairs_of(given), expected);
  EXPECT_THAT(pairs_of(view({})), IsEmpty());
}

TEST(CPairList, HasPairsOfTwoSetsAndOfRectangles) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  std::vector<std::array<double, 4>> rectangles;
  std::vector<broadcl_aabb> flat = boxes;
  for (broadcl_aabb& box : flat) {
    box.lower[2] = box.upper[2] = 0;
    rectangles.push_back({box.lower[0], box.lower[1], box.upper[0], box.upper[1]});
  }
  // The first 80 are one set, the others another.
  constexpr std::uint32_t split = 80;
  Pairs expected;
  for (const broadcl_pair& pair : overlapping(flat)) {
    if (pair.a < split && pair.b >= split) expected.push_back({pair.a, pair.b - split});
  }
  ASSERT_GT(expected.size(), 20U);
  broadcl_boxes first = view(flat);
  first.count = split;
  auto second = sized<broadcl_boxes>();
  second.data = &rectangles[split];
  second.count = rectangles.size() - split;
  second.type = BROADCL_FLOAT64;
  second.dimensions = 2;
  const broadcl_config config = on_host();
  broadcl_pair_list* pairs = nullptr;
  OK(broadcl_pair_list_create_between(&first, &second, &config, &pairs));
  broadcl_pairs found{};
  OK(broadcl_pair_list_get(pairs, &found));
  EXPECT_EQ(list(found), expected);
  OK(broadcl_pair_list_destroy(pairs));
  EXPECT_INVALID("list is null", broadcl_pair_list_create_between, &first, &second, &config, nullptr);
  EXPECT_INVALID("first is null", broadcl_pair_list_create_between, nullptr, &second, &config, &pairs);
  EXPECT_INVALID("second is null", broadcl_pair_list_create_between, &first, nullptr, &config, &pairs);
  second.stride = 7;
  EXPECT_INVALID("second: ", broadcl_pair_list_create_between, &first, &second, &config, &pairs);
}

TEST(CPairList, LacksWhatIsExcluded) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  const Pairs all = overlapping(boxes);
  constexpr std::uint32_t split = 80;
  Pairs exclusions;  // every other pair
  Pairs expected;
  Pairs exclusions_between;
  Pairs expected_between;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto [a, b] = all[k];
    (k % 2 == 0 ? exclusions : expected).push_back(all[k]);
    if (a < split && b >= split) {
      (k % 2 == 0 ? exclusions_between : expected_between).push_back({a, b - split});
    }
  }
  ASSERT_GT(expected_between.size(), 20U);
  std::swap(exclusions[3].a, exclusions[3].b);
  const broadcl_boxes both = view(boxes);
  broadcl_boxes first = both;
  first.count = split;
  broadcl_boxes second = both;
  second.data = &boxes[split];
  second.count = boxes.size() - split;
  const broadcl_config config = on_host();
  const auto found = [&](const broadcl_boxes& s, const broadcl_boxes* t, const Pairs& without) {
    broadcl_pair_list* made = nullptr;
    broadcl_pairs pairs{};
    EXPECT_EQ(broadcl_pair_list_create_excluding(&s, t, without.data(), without.size(), &config, &made),
              BROADCL_SUCCESS)
        << broadcl_last_error();
    EXPECT_EQ(broadcl_pair_list_get(made, &pairs), BROADCL_SUCCESS);
    Pairs result = list(pairs);
    EXPECT_EQ(broadcl_pair_list_destroy(made), BROADCL_SUCCESS);
    return result;
  };
  EXPECT_EQ(found(both, nullptr, exclusions), expected);
  EXPECT_EQ(found(both, nullptr, {}), all);
  EXPECT_EQ(found(first, &second, exclusions_between), expected_between);

  broadcl_pair_list* none = nullptr;
  const broadcl_pair itself{2, 2};
  const broadcl_pair beyond{0, 120};
  EXPECT_FAILED("2 and itself", broadcl_pair_list_create_excluding, &both, nullptr, &itself, 1, &config,
                &none);
  EXPECT_FAILED("(0, 120)", broadcl_pair_list_create_excluding, &first, &second, &beyond, 1, &config, &none);
  EXPECT_INVALID("exclusions is null", broadcl_pair_list_create_excluding, &both, nullptr, nullptr, 1,
                 &config, &none);
  EXPECT_INVALID("first is null", broadcl_pair_list_create_excluding, nullptr, &both, nullptr, 0, &config,
                 &none);
  EXPECT_INVALID("list is null", broadcl_pair_list_create_excluding, &both, nullptr, nullptr, 0, &config,
                 nullptr);
  EXPECT_EQ(none, nullptr);
}

TEST(CPairList, HasWhatSharesALabel) {
  const std::vector<std::uint32_t> faces = {1, 2, 3, 3, 2, 7};
  const std::vector<std::uint32_t> vertices = {0, 1, 2};
  broadcl_pair_list* made = nullptr;
  OK(broadcl_pair_list_create_sharing_between(faces.data(), faces.size(), 3, vertices.data(), vertices.size(),
                                              1, &made));
  broadcl_pairs pairs{};
  OK(broadcl_pair_list_get(made, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{0, 2}, broadcl_pair{1, 2}));
  OK(broadcl_pair_list_destroy(made));
  made = nullptr;
  EXPECT_FAILED("5 labels", broadcl_pair_list_create_sharing_between, faces.data(), 5, 3, vertices.data(), 3,
                1, &made);
  EXPECT_INVALID("first_labels is null", broadcl_pair_list_create_sharing_between, nullptr, 6, 3,
                 vertices.data(), 3, 1, &made);
  EXPECT_INVALID("second_labels is null", broadcl_pair_list_create_sharing_between, faces.data(), 6, 3,
                 nullptr, 3, 1, &made);
  EXPECT_INVALID("list is null", broadcl_pair_list_create_sharing_between, faces.data(), 6, 3,
                 vertices.data(), 3, 1, nullptr);
  EXPECT_EQ(made, nullptr);
}

TEST(CPairList, RefusesBoxesThatAreNone) {
  const std::vector<broadcl_aabb> boxes = {cube(0), cube(nan_value)};
  broadcl_pair_list* pairs = nullptr;
  broadcl_boxes given = view(boxes);
  EXPECT_FAILED("box 1 has a NaN bound", broadcl_pair_list_create, &given, nullptr, &pairs);
  given.type = 7;
  EXPECT_INVALID("boxes->type is 7", broadcl_pair_list_create, &given, nullptr, &pairs);
  given = view(boxes);
  given.dimensions = 4;
  EXPECT_INVALID("boxes->dimensions is 4", broadcl_pair_list_create, &given, nullptr, &pairs);
  given = view(boxes);
  given.stride = 25;
  EXPECT_INVALID("stride", broadcl_pair_list_create, &given, nullptr, &pairs);
  given = view(boxes);
  given.data = nullptr;
  EXPECT_INVALID("null", broadcl_pair_list_create, &given, nullptr, &pairs);
  given.size = 0;
  EXPECT_INVALID("boxes->size is 0", broadcl_pair_list_create, &given, nullptr, &pairs);
  EXPECT_INVALID("boxes is null", broadcl_pair_list_create, nullptr, nullptr, &pairs);
  const broadcl_config config = on_host("frobnicate");
  given = view({cube(0)});
  EXPECT_FAILED("frobnicate", broadcl_pair_list_create, &given, &config, &pairs);
  EXPECT_EQ(pairs, nullptr);
  given = view({});
  OK(broadcl_pair_list_create(&given, nullptr, &pairs));
  EXPECT_INVALID("pairs is null", broadcl_pair_list_get, pairs, nullptr);
  OK(broadcl_pair_list_destroy(pairs));
}

TEST_F(CBroadPhase, ReportsWhatChanges) {
  const std::uint32_t a = add(cube(0));
  const std::uint32_t b = add(cube(0.5F));
  broadcl_delta delta = update();
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{a, b}));
  EXPECT_THAT(list(delta.removed), IsEmpty());

  const broadcl_aabb far = cube(5);
  OK(broadcl_broad_phase_move(handle_, b, &far));
  const std::uint32_t c = add(cube(5.5F));
  delta = update();
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{b, c}));
  EXPECT_THAT(list(delta.removed), ElementsAre(broadcl_pair{a, b}));

  broadcl_filter alone = BROADCL_DEFAULT_FILTER;
  alone.mask = 0;
  OK(broadcl_broad_phase_set_filter(handle_, c, &alone));
  EXPECT_THAT(list(update().removed), ElementsAre(broadcl_pair{b, c}));
  alone = BROADCL_DEFAULT_FILTER;
  OK(broadcl_broad_phase_set_filter(handle_, c, &alone));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{b, c}));
  OK(broadcl_broad_phase_remove(handle_, b));
  EXPECT_THAT(list(update().removed), ElementsAre(broadcl_pair{b, c}));
  std::size_t count = 0;
  OK(broadcl_broad_phase_count(handle_, &count));
  EXPECT_EQ(count, 2U);
  EXPECT_EQ(add(far), b);
  OK(broadcl_broad_phase_update(handle_, nullptr));

  EXPECT_FAILED("no object has the id 99", broadcl_broad_phase_move, handle_, 99, &far);
  EXPECT_FAILED("no object has the id 99", broadcl_broad_phase_remove, handle_, 99);
  EXPECT_FAILED("no object has the id 99", broadcl_broad_phase_set_filter, handle_, 99, &alone);
  const broadcl_aabb invalid = cube(nan_value);
  EXPECT_FAILED("NaN", broadcl_broad_phase_move, handle_, a, &invalid);
}

TEST_F(CBroadPhase, FiltersByBodyAndWorld) {
  broadcl_filter filter = BROADCL_DEFAULT_FILTER;
  filter.body = 5;
  const std::uint32_t a = add(cube(0), &filter);
  add(cube(0), &filter);
  filter.body = BROADCL_NO_BODY;
  filter.world = 3;
  add(cube(0), &filter);
  filter.world = BROADCL_ALL_WORLDS;
  const std::uint32_t d = add(cube(0), &filter);
  const Pairs added = list(update().added);
  EXPECT_THAT(added, ElementsAre(broadcl_pair{a, d}, broadcl_pair{a + 1, d}, broadcl_pair{a + 2, d}));
}

TEST_F(CBroadPhase, TellsTwoSetsApart) {
  const broadcl_filter first = BROADCL_FIRST_SET;
  const broadcl_filter second = BROADCL_SECOND_SET;
  add(cube(0), &first);
  add(cube(0), &first);
  add(cube(0), &second);
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 2}, broadcl_pair{1, 2}));
}

TEST_F(CBroadPhase, NeverReportsWhatIsExcluded) {
  for (int k = 0; k < 3; ++k) add(cube(0));
  // Two labels each: 0 and 1 share the label 5.
  const std::vector<std::uint32_t> labels = {4, 5, 5, 6, 7, 8};
  broadcl_pair_list* sharing = nullptr;
  OK(broadcl_pair_list_create_sharing(labels.data(), labels.size(), 2, &sharing));
  broadcl_pairs pairs{};
  OK(broadcl_pair_list_get(sharing, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}));
  OK(broadcl_broad_phase_set_exclusions(handle_, pairs.data, pairs.count));
  OK(broadcl_pair_list_destroy(sharing));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 2}, broadcl_pair{1, 2}));
  OK(broadcl_broad_phase_set_exclusions(handle_, nullptr, 0));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 1}));

  const broadcl_pair itself{2, 2};
  EXPECT_FAILED("2", broadcl_broad_phase_set_exclusions, handle_, &itself, 1);
  EXPECT_INVALID("pairs is null", broadcl_broad_phase_set_exclusions, handle_, nullptr, 1);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_exclusions, nullptr, &itself, 1);
  sharing = nullptr;
  EXPECT_FAILED("", broadcl_pair_list_create_sharing, labels.data(), 5, 2, &sharing);
  EXPECT_INVALID("labels is null", broadcl_pair_list_create_sharing, nullptr, 6, 2, &sharing);
  EXPECT_INVALID("list is null", broadcl_pair_list_create_sharing, labels.data(), 6, 2, nullptr);
  EXPECT_EQ(sharing, nullptr);
}

TEST_F(CBroadPhase, BoxesAreCopiedOrWrittenInPlace) {
  const std::vector<broadcl_aabb> boxes = random_boxes(100);
  broadcl_boxes given = view(boxes);
  OK(broadcl_broad_phase_set_boxes(handle_, &given));
  EXPECT_EQ(list(update().added), overlapping(boxes));
  broadcl_pairs pairs{};
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  EXPECT_EQ(list(pairs), overlapping(boxes));

  broadcl_aabb* mapped = nullptr;
  OK(broadcl_broad_phase_map(handle_, 2, &mapped));
  mapped[0] = cube(0);
  mapped[1] = cube(nan_value);
  EXPECT_FAILED("box 1 has a NaN bound", broadcl_broad_phase_update, handle_, nullptr);
  EXPECT_EQ(list(pairs), overlapping(boxes)) << "a call that fails leaves the list alone";
  mapped[1] = cube(1);
  update();
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}));
  EXPECT_FAILED("ask for fewer", broadcl_broad_phase_map, handle_, std::size_t{1} << 40U, &mapped);
}

TEST_F(CBroadPhase, ListsStayUntilTheyAreReplaced) {
  add(cube(0));
  const std::uint32_t b = add(cube(0.5F));
  OK(broadcl_broad_phase_begin(handle_));
  const broadcl_aabb far = cube(5);
  OK(broadcl_broad_phase_move(handle_, b, &far));
  broadcl_pairs pairs{};
  broadcl_aabb* mapped = nullptr;
  EXPECT_FAILED("finish", broadcl_broad_phase_pairs, handle_, &pairs);
  EXPECT_FAILED("finish", broadcl_broad_phase_map, handle_, 1, &mapped);
  EXPECT_EQ(mapped, nullptr);
  broadcl_delta delta{};
  OK(broadcl_broad_phase_finish(handle_, &delta));
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  // The next update begins, and an object comes.
  OK(broadcl_broad_phase_begin(handle_));
  add(cube(5.5F));
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{0, 1}));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}));
  OK(broadcl_broad_phase_finish(handle_, &delta));
  EXPECT_THAT(list(delta.removed), ElementsAre(broadcl_pair{0, 1}));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{1, 2}));
}

TEST_F(CBroadPhase, SaysHowItWorks) {
  const broadcl_algorithm* row = nullptr;
  OK(broadcl_broad_phase_algorithm(handle_, &row));
  EXPECT_STREQ(row->name, "sweep-and-prune");
  auto info = sized<broadcl_device_info>();
  info.name = "unchanged";
  OK(broadcl_broad_phase_device(handle_, &info));
  EXPECT_EQ(info.name, nullptr) << "it works on the host";
  EXPECT_EQ(info.size, sizeof info);
}

TEST(CDeathTest, ExhaustedMemoryHasItsStatus) {
  const auto map_in_a_small_process = [] {
    const broadcl_config config = on_host("oracle");
    broadcl_broad_phase* handle = nullptr;
    if (broadcl_broad_phase_create(&config, &handle) != BROADCL_SUCCESS) std::exit(99);
    const rlimit limit{.rlim_cur = rlim_t{2} << 30U, .rlim_max = rlim_t{2} << 30U};
    if (setrlimit(RLIMIT_AS, &limit) != 0) std::exit(98);
    broadcl_aabb* mapped = nullptr;
    const broadcl_status status = broadcl_broad_phase_map(handle, std::size_t{1} << 30U, &mapped);
    std::fputs(broadcl_last_error(), stderr);
    std::exit(status);
  };
  EXPECT_EXIT(map_in_a_small_process(), testing::ExitedWithCode(BROADCL_OUT_OF_MEMORY),
              "broadcl_broad_phase_map: memory of the host is exhausted");
}

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

TEST_F(COnDevice, NeverReportsWhatIsExcluded) {
  const broadcl_device_boxes given = give(std::vector<broadcl_aabb>(3, cube(0)));
  const broadcl_pair excluded{2, 0};
  OK(broadcl_device_broad_phase_set_exclusions(handle_, &excluded, 1));
  auto result = sized<broadcl_device_result>();
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_THAT(read(result.added), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{1, 2}));
  OK(broadcl_device_broad_phase_set_exclusions(handle_, nullptr, 0));
  OK(broadcl_device_broad_phase_update(handle_, &given, &result));
  EXPECT_THAT(read(result.added), ElementsAre(broadcl_pair{0, 2}));
  const broadcl_pair itself{2, 2};
  EXPECT_FAILED("2", broadcl_device_broad_phase_set_exclusions, handle_, &itself, 1);
  EXPECT_INVALID("pairs is null", broadcl_device_broad_phase_set_exclusions, handle_, nullptr, 1);
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
  EXPECT_FAILED("reserve()", broadcl_device_broad_phase_enqueue, handle_, &given, &changes);
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
  EXPECT_FAILED("oracle", broadcl_device_broad_phase_create, queue_, &config, &other);
  config.size = 0;
  EXPECT_INVALID("config->size is 0", broadcl_device_broad_phase_create, queue_, &config, &other);
  EXPECT_EQ(other, nullptr);
  broadcl_device_boxes given = give({cube(0), cube(1)});
  given.count = 3;
  EXPECT_FAILED("too few", broadcl_device_broad_phase_update, handle_, &given, nullptr);
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
    std::string kept_in = "unchanged";
  } heard;
  auto config = sized<broadcl_config>();
  config.device = id_.c_str();
  config.algorithm = "brute-force";
  config.profile = 1;
  config.on_compile = [](const broadcl_device_info* device, const char* kept_in, void* data) {
    auto& hears = *static_cast<Heard*>(data);
    ++hears.times;
    hears.label = device->label;
    hears.kept_in = kept_in;
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
  EXPECT_EQ(heard.kept_in, "");
  const std::vector<broadcl_aabb> boxes = random_boxes(60);
  const broadcl_boxes given = view(boxes);
  OK(broadcl_broad_phase_set_boxes(handle, &given));
  broadcl_delta delta{};
  OK(broadcl_broad_phase_update(handle, &delta));
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
