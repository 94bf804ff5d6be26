#include <sys/resource.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "c_test.hpp"

namespace broadcl::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// A broad phase on the host.
class CBroadPhase : public testing::Test {
 protected:
  void SetUp() override {
    const broadcl_config config = on_host();
    OK(broadcl_broad_phase_create(&config, &handle_));
  }
  void TearDown() override { OK(broadcl_broad_phase_destroy(handle_)); }

  std::uint32_t add(const broadcl_aabb& box, const broadcl_filter* filter = nullptr) {
    const broadcl_boxes boxes = view_of_one(box);
    std::uint32_t id = 77;
    EXPECT_EQ(broadcl_broad_phase_add(handle_, &boxes, filter, filter == nullptr ? 0 : 1, &id),
              BROADCL_SUCCESS)
        << broadcl_last_error();
    return id;
  }
  broadcl_status move(std::uint32_t id, const broadcl_aabb& box) {
    const broadcl_boxes boxes = view_of_one(box);
    return broadcl_broad_phase_move(handle_, &id, 1, &boxes);
  }
  broadcl_delta update() {
    broadcl_delta delta{};
    EXPECT_EQ(broadcl_broad_phase_update(handle_, &delta), BROADCL_SUCCESS) << broadcl_last_error();
    return delta;
  }

  broadcl_broad_phase* handle_ = nullptr;
};

TEST_F(CBroadPhase, NullArgumentsAreRefusedAndChangeNothing) {
  const broadcl_aabb box = cube(0);
  const broadcl_boxes boxes = view_of_one(box);
  const broadcl_algorithm* rows = nullptr;
  const broadcl_stage* stages = nullptr;
  const void* bytes = nullptr;
  std::size_t n = 77;
  std::uint32_t id = 77;
  EXPECT_INVALID("filter is null", broadcl_broad_phase_set_filter, handle_, 0, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_map, handle_, 1, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_update_boxes, handle_, nullptr, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_begin_boxes, handle_, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_add, handle_, nullptr, nullptr, 0, &id);
  EXPECT_INVALID("ids is null", broadcl_broad_phase_add, handle_, &boxes, nullptr, 0, nullptr);
  EXPECT_INVALID("filters is null", broadcl_broad_phase_add, handle_, &boxes, nullptr, 1, &id);
  EXPECT_INVALID("ids is null", broadcl_broad_phase_move, handle_, nullptr, 1, &boxes);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_move, handle_, &id, 1, nullptr);
  EXPECT_INVALID("ids is null", broadcl_broad_phase_remove, handle_, nullptr, 1);
  EXPECT_INVALID("contains is null", broadcl_broad_phase_contains, handle_, 0, nullptr);
  EXPECT_INVALID("box is null", broadcl_broad_phase_box, handle_, 0, nullptr);
  EXPECT_INVALID("filter is null", broadcl_broad_phase_filter, handle_, 0, nullptr);
  EXPECT_INVALID("pairs is null", broadcl_broad_phase_pairs, handle_, nullptr);
  EXPECT_INVALID("ids is null", broadcl_broad_phase_ids, handle_, nullptr, &n);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_boxes, handle_, nullptr, &n);
  EXPECT_INVALID("filters is null", broadcl_broad_phase_filters, handle_, nullptr, &n);
  EXPECT_INVALID("reaches is null", broadcl_broad_phase_reaches, handle_, nullptr, &n);
  EXPECT_INVALID("pairs is null", broadcl_broad_phase_exclusions, handle_, nullptr);
  const std::uint32_t* ids = nullptr;
  EXPECT_INVALID("count is null", broadcl_broad_phase_ids, handle_, &ids, nullptr);
  EXPECT_INVALID("ids is null", broadcl_broad_phase_set_filters, handle_, nullptr, 1, nullptr, 0);
  EXPECT_INVALID("filters is null", broadcl_broad_phase_set_filters, handle_, &id, 1, nullptr, 1);
  EXPECT_INVALID("bytes is null", broadcl_broad_phase_save, handle_, nullptr, &n);
  EXPECT_INVALID("size is null", broadcl_broad_phase_save, handle_, &bytes, nullptr);
  EXPECT_INVALID("bytes is null", broadcl_broad_phase_restore, handle_, nullptr, 1, nullptr);
  EXPECT_INVALID("size is null", broadcl_broad_phase_size, handle_, nullptr);
  EXPECT_INVALID("info is null", broadcl_broad_phase_device, handle_, nullptr);
  EXPECT_INVALID("row is null", broadcl_broad_phase_algorithm, handle_, nullptr);
  EXPECT_INVALID("use is null", broadcl_broad_phase_memory, handle_, nullptr);
  EXPECT_INVALID("stages is null", broadcl_broad_phase_profile, handle_, nullptr, &n);
  EXPECT_INVALID("count is null", broadcl_broad_phase_profile, handle_, &stages, nullptr);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_create, nullptr, nullptr);
  EXPECT_INVALID("list is null", broadcl_pair_list_create, &boxes, nullptr, nullptr, 0, nullptr, nullptr);
  EXPECT_INVALID("rows is null", broadcl_algorithms, nullptr, &n);
  EXPECT_INVALID("count is null", broadcl_algorithms, &rows, nullptr);
  EXPECT_EQ(id, 77U);
  EXPECT_EQ(n, 77U);
  OK(broadcl_broad_phase_size(handle_, &n));
  EXPECT_EQ(n, 0U);
}

template <class Item>
std::vector<Item> to_vector(const Item* items, std::size_t count) {
  return {items, items + count};
}

TEST_F(CBroadPhase, ReturnsWhatIsSetOfAllObjects) {
  for (const float x : {0.0F, 0.5F, 1.0F}) add(cube(x));
  const std::uint32_t first = 0;
  OK(broadcl_broad_phase_remove(handle_, &first, 1));
  const std::array<std::uint32_t, 2> objects{2, 1};
  const std::array<broadcl_filter, 2> rules{broadcl_filter{4, 5, 6, 7}, broadcl_filter{1, 1, 9, 0}};
  OK(broadcl_broad_phase_set_filters(handle_, objects.data(), 2, rules.data(), 2));
  const double reach = 0.25;
  OK(broadcl_broad_phase_set_reach(handle_, &objects[0], 1, &reach, 1));
  const std::array<broadcl_pair, 3> excluded{broadcl_pair{3, 2}, {2, 3}, {0, 1}};
  OK(broadcl_broad_phase_set_exclusions(handle_, excluded.data(), excluded.size()));

  std::size_t count = 0;
  const std::uint32_t* ids = nullptr;
  OK(broadcl_broad_phase_ids(handle_, &ids, &count));
  EXPECT_THAT(to_vector(ids, count), ElementsAre(1, 2));
  const broadcl_aabb* boxes = nullptr;
  OK(broadcl_broad_phase_boxes(handle_, &boxes, &count));
  ASSERT_EQ(count, 2U);
  EXPECT_EQ(boxes[0].lower[0], 0.5F);
  EXPECT_EQ(boxes[1].upper[0], 2);
  const broadcl_filter* filters = nullptr;
  OK(broadcl_broad_phase_filters(handle_, &filters, &count));
  ASSERT_EQ(count, 2U);
  EXPECT_EQ(filters[0].body, 9U);
  EXPECT_EQ(filters[1].group, 4U);
  EXPECT_EQ(filters[1].mask, 5U);
  EXPECT_EQ(filters[1].world, 7U);
  const double* reaches = nullptr;
  OK(broadcl_broad_phase_reaches(handle_, &reaches, &count));
  EXPECT_THAT(to_vector(reaches, count), ElementsAre(0, 0.25));
  broadcl_pairs exclusions{};
  OK(broadcl_broad_phase_exclusions(handle_, &exclusions));
  EXPECT_THAT(list(exclusions), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{2, 3}));

  // All are still valid: each call has its own memory.
  EXPECT_THAT(to_vector(ids, 2), ElementsAre(1, 2));
  EXPECT_EQ(boxes[0].lower[0], 0.5F);
  EXPECT_EQ(filters[0].body, 9U);

  const std::array<std::uint32_t, 2> unknown{1, 0};
  EXPECT_INVALID("no object has the id 0", broadcl_broad_phase_set_filters, handle_, unknown.data(), 2,
                 rules.data(), 2);
  EXPECT_INVALID("2 filters for 1 objects", broadcl_broad_phase_set_filters, handle_, objects.data(), 1,
                 rules.data(), 2);
  EXPECT_INVALID("0 filters for 2 objects", broadcl_broad_phase_set_filters, handle_, objects.data(), 2,
                 nullptr, 0);
  OK(broadcl_broad_phase_filters(handle_, &filters, &count));
  EXPECT_EQ(filters[0].body, 9U);
  OK(broadcl_broad_phase_set_filters(handle_, objects.data(), 2, rules.data(), 1));
  OK(broadcl_broad_phase_filters(handle_, &filters, &count));
  EXPECT_EQ(filters[0].body, 6U);
  OK(broadcl_broad_phase_shrink(handle_));
  OK(broadcl_broad_phase_ids(handle_, &ids, &count));
  EXPECT_THAT(to_vector(ids, count), ElementsAre(1, 2));
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
  OK(broadcl_pair_list_create_sharing(labels.data(), labels.size(), 2, nullptr, 0, 0, &sharing));
  broadcl_pairs pairs{};
  OK(broadcl_pair_list_pairs(sharing, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}));
  OK(broadcl_broad_phase_set_exclusions(handle_, pairs.data, pairs.count));
  OK(broadcl_pair_list_destroy(sharing));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 2}, broadcl_pair{1, 2}));
  OK(broadcl_broad_phase_set_exclusions(handle_, nullptr, 0));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 1}));

  const broadcl_pair itself{2, 2};
  EXPECT_INVALID("2", broadcl_broad_phase_set_exclusions, handle_, &itself, 1);
  EXPECT_INVALID("pairs is null", broadcl_broad_phase_set_exclusions, handle_, nullptr, 1);
  EXPECT_INVALID("do not fit", broadcl_broad_phase_set_exclusions, handle_, &itself, SIZE_MAX / 4 + 1);
  EXPECT_INVALID("broad_phase is null", broadcl_broad_phase_set_exclusions, nullptr, &itself, 1);
}

TEST_F(CBroadPhase, BoxesAreCopiedOrWrittenInPlace) {
  const std::vector<broadcl_aabb> boxes = random_boxes(100);
  broadcl_boxes given = view(boxes);
  broadcl_delta delta{};
  OK(broadcl_broad_phase_update_boxes(handle_, &given, &delta));
  EXPECT_EQ(list(delta.added), overlapping(boxes));
  broadcl_pairs pairs{};
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  EXPECT_EQ(list(pairs), overlapping(boxes));

  broadcl_aabb* mapped = nullptr;
  OK(broadcl_broad_phase_map(handle_, 2, &mapped));
  mapped[0] = cube(0);
  mapped[1] = cube(nan_value);
  EXPECT_INVALID("box 1 has a NaN bound", broadcl_broad_phase_update, handle_, nullptr);
  EXPECT_EQ(list(pairs), overlapping(boxes)) << "a call that fails leaves the list alone";
  mapped[1] = cube(1);
  update();
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}));
  EXPECT_INVALID("too many", broadcl_broad_phase_map, handle_, std::size_t{1} << 40U, &mapped);
  given.count = std::size_t{1} << 50U;
  EXPECT_INVALID("too many", broadcl_broad_phase_update_boxes, handle_, &given, nullptr);
}

TEST_F(CBroadPhase, ListsStayUntilTheyAreReplaced) {
  add(cube(0));
  const std::uint32_t b = add(cube(0.5F));
  OK(broadcl_broad_phase_begin(handle_));
  OK(move(b, cube(5)));
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

TEST_F(CBroadPhase, GoesBackToWhatWasSaved) {
  const std::uint32_t a = add(cube(0));
  const std::uint32_t b = add(cube(0.5F));
  const void* bytes = nullptr;
  std::size_t size = 0;
  EXPECT_FAILED("no update has reported", broadcl_broad_phase_save, handle_, &bytes, &size);
  (void)update();
  OK(broadcl_broad_phase_begin(handle_));
  EXPECT_FAILED("finish", broadcl_broad_phase_save, handle_, &bytes, &size);
  OK(broadcl_broad_phase_finish(handle_, nullptr));
  OK(broadcl_broad_phase_save(handle_, &bytes, &size));
  const auto* first = static_cast<const unsigned char*>(bytes);
  std::vector<unsigned char> copy(first, first + size);

  OK(broadcl_broad_phase_remove(handle_, &b, 1));
  OK(move(a, cube(5)));
  (void)update();
  broadcl_delta delta{};
  OK(broadcl_broad_phase_restore(handle_, bytes, size, &delta));
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{a, b}));
  EXPECT_THAT(list(delta.removed), IsEmpty());
  OK(broadcl_broad_phase_begin(handle_));
  EXPECT_FAILED("finish", broadcl_broad_phase_restore, handle_, copy.data(), size, nullptr);
  OK(broadcl_broad_phase_finish(handle_, nullptr));

  broadcl_config config = on_host();
  broadcl_broad_phase* other = nullptr;
  OK(broadcl_broad_phase_create(&config, &other));
  OK(broadcl_broad_phase_restore(other, copy.data(), size, nullptr));
  broadcl_pairs pairs{};
  OK(broadcl_broad_phase_pairs(other, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{a, b}));
  EXPECT_INVALID("damaged", broadcl_broad_phase_restore, other, copy.data(), size - 1, nullptr);
  EXPECT_INVALID("damaged", broadcl_broad_phase_restore, other, nullptr, 0, nullptr);
  OK(broadcl_broad_phase_destroy(other));
  config.type = BROADCL_FLOAT64;
  OK(broadcl_broad_phase_create(&config, &other));
  EXPECT_INVALID("not those of a state in float64", broadcl_broad_phase_restore, other, copy.data(), size,
                 nullptr);
  OK(broadcl_broad_phase_destroy(other));
  copy[0] ^= 1;
  EXPECT_INVALID("not those of a state", broadcl_broad_phase_restore, handle_, copy.data(), size, nullptr);
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

/// Three boxes in a row: the first two are flush, the third is apart by an ulp.
std::vector<broadcl_aabb64> row64() {
  const double x = 6.4e6;
  return {{{x, 0, 0}, {x + 1, 1, 1}},
          {{x + 1, 0, 0}, {x + 2, 1, 1}},
          {{std::nextafter(x + 2, 1e30), 0, 0}, {x + 3, 1, 1}}};
}

broadcl_boxes view64(const std::vector<broadcl_aabb64>& boxes) {
  auto result = sized<broadcl_boxes>();
  result.data = boxes.data();
  result.count = boxes.size();
  result.type = BROADCL_FLOAT64;
  return result;
}

/// A broad phase in double precision.
class CBroadPhase64 : public CBroadPhase {
 protected:
  void SetUp() override {
    broadcl_config config = on_host();
    config.type = BROADCL_FLOAT64;
    OK(broadcl_broad_phase_create(&config, &handle_));
  }
};

TEST_F(CBroadPhase64, PairsAreExactWhicheverFunctionGivesTheBoxes) {
  std::vector<broadcl_aabb64> boxes = row64();
  broadcl_boxes given = view64(boxes);
  std::vector<std::uint32_t> ids(3);
  OK(broadcl_broad_phase_add(handle_, &given, nullptr, 0, ids.data()));
  EXPECT_THAT(list(update().added), ElementsAre(broadcl_pair{0, 1}));
  std::swap(boxes[0], boxes[2]);
  OK(broadcl_broad_phase_move(handle_, ids.data(), ids.size(), &given));
  broadcl_delta delta = update();
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{1, 2}));
  EXPECT_THAT(list(delta.removed), ElementsAre(broadcl_pair{0, 1}));
  broadcl_aabb64 box{};
  OK(broadcl_broad_phase_box64(handle_, 0, &box));
  EXPECT_EQ(box.lower[0], boxes[0].lower[0]);
  boxes[0].lower[0] = boxes[1].upper[0];
  OK(broadcl_broad_phase_update_boxes(handle_, &given, &delta));
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{0, 1}));
  given.count = std::size_t{1} << 50U;
  EXPECT_INVALID("too many", broadcl_broad_phase_update_boxes, handle_, &given, &delta);
  EXPECT_INVALID("too many", broadcl_broad_phase_begin_boxes, handle_, &given);
  EXPECT_INVALID("too many", broadcl_broad_phase_add, handle_, &given, nullptr, 0, ids.data());
  given.count = boxes.size();
  broadcl_aabb64* mapped = nullptr;
  OK(broadcl_broad_phase_map64(handle_, 3, &mapped));
  EXPECT_EQ(mapped[0].lower[0], boxes[0].lower[0]);
  mapped[0].lower[0] = std::nextafter(mapped[0].lower[0], 1e30);
  EXPECT_THAT(list(update().removed), ElementsAre(broadcl_pair{0, 1}));
  OK(broadcl_broad_phase_begin_boxes(handle_, &given));
  OK(broadcl_broad_phase_finish(handle_, &delta));
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{0, 1}));
  broadcl_pairs pairs{};
  OK(broadcl_broad_phase_pairs(handle_, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{1, 2}));
}

TEST_F(CBroadPhase64, FunctionsForTheOtherTypeAreRefused) {
  add(cube(0));
  broadcl_aabb box{};
  broadcl_aabb* boxes = nullptr;
  EXPECT_INVALID("call broadcl_broad_phase_box64()", broadcl_broad_phase_box, handle_, 0, &box);
  EXPECT_INVALID("call broadcl_broad_phase_map64()", broadcl_broad_phase_map, handle_, 1, &boxes);
  const broadcl_aabb* all = nullptr;
  std::size_t count = 0;
  EXPECT_INVALID("call broadcl_broad_phase_boxes64()", broadcl_broad_phase_boxes, handle_, &all, &count);
  const broadcl_aabb64* all64 = nullptr;
  OK(broadcl_broad_phase_boxes64(handle_, &all64, &count));
  ASSERT_EQ(count, 1U);
  EXPECT_EQ(all64->upper[0], 1);
  EXPECT_INVALID("box is null", broadcl_broad_phase_box64, handle_, 0, nullptr);
  EXPECT_INVALID("boxes is null", broadcl_broad_phase_map64, handle_, 1, nullptr);
  broadcl_aabb64 box64{};
  EXPECT_INVALID("no object has the id 5", broadcl_broad_phase_box64, handle_, 5, &box64);
}

TEST_F(CBroadPhase, FunctionsForDoublePrecisionAreRefused) {
  add(cube(0));
  broadcl_aabb64 box{};
  broadcl_aabb64* boxes = nullptr;
  EXPECT_INVALID("call broadcl_broad_phase_box()", broadcl_broad_phase_box64, handle_, 0, &box);
  EXPECT_INVALID("call broadcl_broad_phase_map()", broadcl_broad_phase_map64, handle_, 1, &boxes);
  const broadcl_aabb64* all = nullptr;
  std::size_t count = 0;
  EXPECT_INVALID("call broadcl_broad_phase_boxes()", broadcl_broad_phase_boxes64, handle_, &all, &count);
  broadcl_config config = on_host();
  config.type = 2;
  broadcl_broad_phase* other = nullptr;
  EXPECT_INVALID("config->type is 2", broadcl_broad_phase_create, &config, &other);
  EXPECT_EQ(other, nullptr);
}

}  // namespace
}  // namespace broadcl::test
