#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "c_test.hpp"

namespace broadcl::test {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

using Lists = std::vector<std::vector<std::uint32_t>>;

using Numbers = std::vector<double>;

constexpr double infinite = std::numeric_limits<double>::infinity();

/// The hits of a list, which is destroyed.
/// @param squared_distances, times One per hit, or null if there must be none.
Lists taken_from(broadcl_hit_list* made, Numbers* squared_distances = nullptr, Numbers* times = nullptr) {
  broadcl_hits hits{};
  EXPECT_EQ(broadcl_hit_list_hits(made, &hits), BROADCL_SUCCESS) << broadcl_last_error();
  const auto take = [&](const double* numbers, Numbers* to) {
    if (to == nullptr) {
      EXPECT_EQ(numbers, nullptr);
    } else {
      to->assign(numbers, numbers + hits.offsets[hits.query_count]);
    }
  };
  take(hits.squared_distances, squared_distances);
  take(hits.times, times);
  Lists lists(hits.query_count);
  for (std::size_t k = 0; k < lists.size(); ++k) {
    lists[k].assign(hits.ids + hits.offsets[k], hits.ids + hits.offsets[k + 1]);
  }
  EXPECT_EQ(broadcl_hit_list_destroy(made), BROADCL_SUCCESS);
  return lists;
}

Lists found_by(const broadcl_broad_phase* handle, const std::vector<broadcl_aabb>& queries,
               const broadcl_query_options* options = nullptr) {
  const broadcl_boxes given = view(queries);
  broadcl_hit_list* made = nullptr;
  EXPECT_EQ(broadcl_broad_phase_overlapping(handle, &given, options, &made), BROADCL_SUCCESS)
      << broadcl_last_error();
  return taken_from(made);
}

/// What each box of a set overlaps, itself too.
Lists expected_of(const std::vector<broadcl_aabb>& boxes) {
  Lists lists(boxes.size());
  for (std::uint32_t k = 0; k < boxes.size(); ++k) lists[k].push_back(k);
  for (const broadcl_pair& pair : overlapping(boxes)) {
    lists[pair.a].push_back(pair.b);
    lists[pair.b].insert(lists[pair.b].end() - 1, pair.a);
  }
  for (std::vector<std::uint32_t>& list : lists) std::ranges::sort(list);
  return lists;
}

broadcl_aabb point(float x) {
  return {{x, 0, 0}, {x, 0, 0}};
}

class CQueries : public testing::TestWithParam<broadcl_type> {
 protected:
  void SetUp() override {
    broadcl_config config = on_host();
    config.type = GetParam();
    OK(broadcl_broad_phase_create(&config, &handle_));
  }
  void TearDown() override { OK(broadcl_broad_phase_destroy(handle_)); }

  void add(const std::vector<broadcl_aabb>& boxes) {
    const broadcl_boxes given = view(boxes);
    std::vector<std::uint32_t> ids(boxes.size());
    OK(broadcl_broad_phase_add(handle_, &given, nullptr, 0, ids.data()));
  }
  Pairs updated() {
    broadcl_pairs pairs{};
    EXPECT_EQ(broadcl_broad_phase_update(handle_, nullptr), BROADCL_SUCCESS) << broadcl_last_error();
    EXPECT_EQ(broadcl_broad_phase_pairs(handle_, &pairs), BROADCL_SUCCESS);
    return list(pairs);
  }

  broadcl_broad_phase* handle_ = nullptr;
};
INSTANTIATE_TEST_SUITE_P(Types, CQueries, testing::Values(BROADCL_FLOAT32, BROADCL_FLOAT64),
                         [](const auto& type) {
                           return type.param == BROADCL_FLOAT32 ? "float32" : "float64";
                         });

TEST_P(CQueries, AreLimitedAndFiltered) {
  const std::vector<broadcl_aabb> boxes(5, cube(0));
  add(boxes);
  const broadcl_filter other = {2, UINT32_C(0xffffffff), BROADCL_NO_BODY, 0};
  OK(broadcl_broad_phase_set_filter(handle_, 3, &other));
  auto options = sized<broadcl_query_options>();
  options.limit = 2;
  EXPECT_THAT(found_by(handle_, {cube(0.5F), cube(5)}, &options), ElementsAre(ElementsAre(0, 1), IsEmpty()));
  options.limit = 0;
  const std::vector<broadcl_filter> filters = {{1, 2, BROADCL_NO_BODY, 0}, {1, 4, BROADCL_NO_BODY, 0}};
  options.filters = filters.data();
  options.filter_count = 2;
  EXPECT_THAT(found_by(handle_, {cube(0), cube(0)}, &options), ElementsAre(ElementsAre(3), IsEmpty()));

  options = sized<broadcl_query_options>();
  options.most_hits = 9;
  const std::vector<broadcl_aabb> two(2, cube(0));
  const broadcl_boxes given = view(two);
  broadcl_hit_list* made = nullptr;
  EXPECT_FAILED("more than 9", broadcl_broad_phase_overlapping, handle_, &given, &options, &made);
  EXPECT_EQ(made, nullptr);
  options.most_hits = 0;
  options.count_only = 1;
  OK(broadcl_broad_phase_overlapping(handle_, &given, &options, &made));
  broadcl_hits hits{};
  OK(broadcl_hit_list_hits(made, &hits));
  EXPECT_EQ(hits.query_count, 2U);
  EXPECT_EQ(hits.offsets[2], 10U);
  EXPECT_EQ(hits.ids, nullptr);
  OK(broadcl_hit_list_destroy(made));
}

TEST_P(CQueries, MeetWhatReachesThem) {
  add({point(0), point(3), point(7)});
  EXPECT_THAT(updated(), IsEmpty());
  const std::vector<std::uint32_t> ids = {0, 1};
  const std::vector<double> reaches = {1, 2};
  OK(broadcl_broad_phase_set_reach(handle_, ids.data(), 2, reaches.data(), 2));
  EXPECT_THAT(updated(), ElementsAre(broadcl_pair{0, 1}));
  double reach = 0;
  OK(broadcl_broad_phase_reach(handle_, 1, &reach));
  EXPECT_EQ(reach, 2);
  const double tenth = 0.1;
  OK(broadcl_broad_phase_set_reach(handle_, &ids[0], 1, &tenth, 1));
  OK(broadcl_broad_phase_reach(handle_, 0, &reach));
  EXPECT_EQ(reach, GetParam() == BROADCL_FLOAT64 ? tenth : static_cast<double>(static_cast<float>(tenth)));
  EXPECT_THAT(updated(), IsEmpty());
  auto options = sized<broadcl_query_options>();
  EXPECT_THAT(found_by(handle_, {point(6)}, &options), ElementsAre(IsEmpty()));
  options.within = 1;
  EXPECT_THAT(found_by(handle_, {point(6)}, &options), ElementsAre(ElementsAre(1, 2)));

  const double bad = -1;
  EXPECT_INVALID("reach", broadcl_broad_phase_set_reach, handle_, ids.data(), 2, &bad, 1);
  EXPECT_INVALID("reaches is null", broadcl_broad_phase_set_reach, handle_, ids.data(), 2, nullptr, 2);
  EXPECT_INVALID("no object has the id 3", broadcl_broad_phase_reach, handle_, 3, &reach);
  EXPECT_INVALID("reach is null", broadcl_broad_phase_reach, handle_, 0, nullptr);
}

TEST_P(CQueries, RefuseWaysThatLeadNowhere) {
  add({cube(0)});
  const std::vector<broadcl_aabb> starts = {point(0), point(1)};
  const broadcl_boxes given = view(starts);
  const Numbers directions = {1, 0, 0, 1, 0, 0};
  const Numbers lengths = {1, 2, 3};
  broadcl_hit_list* made = nullptr;
  const auto refused = [&](const char* text, const broadcl_boxes* of, const double* ways,
                           std::size_t way_count, const double* far, std::size_t far_count,
                           const broadcl_query_options* options) {
    SCOPED_TRACE(text);
    EXPECT_INVALID(text, broadcl_broad_phase_along, handle_, of, ways, way_count, far, far_count, options,
                   &made);
    EXPECT_INVALID(text, broadcl_hit_list_create_along, of, of, ways, way_count, far, far_count, options,
                   nullptr, &made);
  };
  const double* ways = directions.data();
  refused("starts is null", nullptr, ways, 2, nullptr, 0, nullptr);
  refused("directions is null", &given, nullptr, 2, nullptr, 0, nullptr);
  refused("0 directions for 2 queries", &given, nullptr, 0, nullptr, 0, nullptr);
  refused("lengths is null", &given, ways, 2, nullptr, 1, nullptr);
  refused("3 lengths for 2 queries", &given, ways, 2, lengths.data(), 3, nullptr);
  for (const double bad : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
    const Numbers of_second = {1, bad};
    refused("length 1 is", &given, ways, 2, of_second.data(), 2, nullptr);
  }
  for (const double bad : {infinite, std::numeric_limits<double>::quiet_NaN()}) {
    const Numbers of_second = {1, 0, 0, 0, bad, 0};
    refused("direction 1 is infinite or NaN", &given, of_second.data(), 2, nullptr, 0, nullptr);
  }
  const std::vector<broadcl_aabb> far = {point(0), point(std::numeric_limits<float>::infinity())};
  const broadcl_boxes endless = view(far);
  refused("start 1 is infinite", &endless, ways, 1, nullptr, 0, nullptr);
  const std::vector<broadcl_aabb> with_nan = {point(0), point(nan_value)};
  const broadcl_boxes bad = view(with_nan);
  refused("box 1 has a NaN bound", &bad, ways, 1, nullptr, 0, nullptr);
  auto options = sized<broadcl_query_options>();
  options.within = 1;
  refused("within", &given, ways, 2, nullptr, 0, &options);
  EXPECT_INVALID("list is null", broadcl_broad_phase_along, handle_, &given, ways, 2, nullptr, 0, nullptr,
                 nullptr);
  EXPECT_EQ(made, nullptr);
}

TEST_P(CQueries, SeveralThreadsMayAsk) {
  const std::vector<broadcl_aabb> boxes = random_boxes(500);
  add(boxes);
  const Lists expected = expected_of(boxes);
  std::array<std::thread, 4> threads;
  for (std::thread& thread : threads)
    thread = std::thread([&] { EXPECT_EQ(found_by(handle_, boxes), expected); });
  for (std::thread& thread : threads) thread.join();
}

TEST(CHitList, HasWhatIsFoundOnce) {
  const std::vector<broadcl_aabb> boxes = random_boxes(200);
  const broadcl_boxes given = view(boxes);
  broadcl_hit_list* made = nullptr;
  OK(broadcl_hit_list_create(&given, &given, nullptr, nullptr, &made));
  EXPECT_EQ(taken_from(made), expected_of(boxes));
  const broadcl_boxes none = view({});
  OK(broadcl_hit_list_create(&given, &none, nullptr, nullptr, &made));
  EXPECT_THAT(taken_from(made), IsEmpty());
  OK(broadcl_hit_list_create(&none, &given, nullptr, nullptr, &made));
  EXPECT_EQ(taken_from(made), Lists(200));

  auto options = sized<broadcl_query_options>();
  options.limit = 1;
  Numbers numbers;
  const broadcl_boxes one = view_of_one(boxes[7]);
  OK(broadcl_hit_list_create_nearest(&one, &given, &options, nullptr, &made));
  EXPECT_EQ(taken_from(made, &numbers), Lists(200, {0}));
  EXPECT_EQ(numbers[7], 0);
  const Numbers direction = {0, 0, 0};
  OK(broadcl_hit_list_create_along(&given, &given, direction.data(), 1, nullptr, 0, nullptr, nullptr, &made));
  EXPECT_EQ(taken_from(made, nullptr, &numbers), expected_of(boxes));
  EXPECT_THAT(numbers, Each(0));

  made = nullptr;
  const std::vector<broadcl_aabb> bad = {cube(0), cube(nan_value)};
  const broadcl_boxes with_nan = view(bad);
  EXPECT_INVALID("box 1 has a NaN bound", broadcl_hit_list_create, &given, &with_nan, nullptr, nullptr,
                 &made);
  options = sized<broadcl_query_options>();
  options.except_count = 3;
  EXPECT_INVALID("options->except is null", broadcl_hit_list_create, &given, &given, &options, nullptr,
                 &made);
  options = sized<broadcl_query_options>();
  options.filter_count = 3;
  EXPECT_INVALID("options->filters is null", broadcl_hit_list_create, &given, &given, &options, nullptr,
                 &made);
  options.size = 3;
  EXPECT_INVALID("options->size is 3", broadcl_hit_list_create, &given, &given, &options, nullptr, &made);
  EXPECT_INVALID("queries is null", broadcl_hit_list_create, &given, nullptr, nullptr, nullptr, &made);
  EXPECT_INVALID("queries is null", broadcl_hit_list_create_nearest, &given, nullptr, nullptr, nullptr,
                 &made);
  EXPECT_INVALID("boxes is null", broadcl_hit_list_create_nearest, nullptr, &given, nullptr, nullptr, &made);
  EXPECT_INVALID("list is null", broadcl_hit_list_create, &given, &given, nullptr, nullptr, nullptr);
  EXPECT_EQ(made, nullptr);
}

TEST(CDistances, ArePairsWithinOne) {
  const std::vector<broadcl_aabb> points = {point(0), point(3), point(3.5F), {{1, 0, 0}, {0, 0, 0}}};
  const broadcl_boxes given = view(points);
  broadcl_config config = on_host();
  config.distance = 3;
  broadcl_pair_list* made = nullptr;
  OK(broadcl_pair_list_create(&given, nullptr, nullptr, 0, &config, &made));
  broadcl_pairs pairs{};
  OK(broadcl_pair_list_pairs(made, &pairs));
  EXPECT_THAT(list(pairs), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{1, 2}));
  std::vector<double> distances(2);
  OK(broadcl_squared_distances(&given, nullptr, pairs.data, pairs.count, nullptr, distances.data()));
  EXPECT_THAT(distances, ElementsAre(9, 0.25));
  OK(broadcl_pair_list_destroy(made));
  const broadcl_pair of_two[] = {{1, 0}, {3, 0}};
  const broadcl_boxes second = view_of_one(points[2]);
  OK(broadcl_squared_distances(&given, &second, of_two, 2, &config, distances.data()));
  EXPECT_THAT(distances, ElementsAre(0.25, std::numeric_limits<double>::infinity()));

  broadcl_broad_phase* handle = nullptr;
  OK(broadcl_broad_phase_create(&config, &handle));
  broadcl_delta delta{};
  OK(broadcl_broad_phase_update_boxes(handle, &given, &delta));
  EXPECT_THAT(list(delta.added), ElementsAre(broadcl_pair{0, 1}, broadcl_pair{1, 2}));
  double reach = 0;
  OK(broadcl_broad_phase_reach(handle, 0, &reach));
  EXPECT_EQ(reach, 1.5);
  const std::uint32_t id = 0;
  EXPECT_INVALID("distance", broadcl_broad_phase_set_reach, handle, &id, 1, &reach, 1);
  OK(broadcl_broad_phase_destroy(handle));

  const broadcl_pair beyond{0, 4};
  EXPECT_INVALID("(0, 4)", broadcl_squared_distances, &given, nullptr, &beyond, 1, nullptr, distances.data());
  EXPECT_INVALID("distances is null", broadcl_squared_distances, &given, nullptr, &beyond, 1, nullptr,
                 nullptr);
  EXPECT_INVALID("pairs is null", broadcl_squared_distances, &given, nullptr, nullptr, 1, nullptr,
                 distances.data());
  config.distance = -1;
  EXPECT_INVALID("distance", broadcl_pair_list_create, &given, nullptr, nullptr, 0, &config, &made);
}

}  // namespace
}  // namespace broadcl::test
