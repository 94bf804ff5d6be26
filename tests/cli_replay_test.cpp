// `broadcl simulate --record` and `broadcl replay`, run as users run them.
#include <BulletCollision/BroadphaseCollision/btBroadphaseInterface.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>

#include <sys/stat.h>

#include <csignal>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <broadcl/broad_phase.hpp>
#include <broadcl/broad_phase64.hpp>

#include "cli/recording.hpp"
#include "scenes/broadphases.hpp"
#include "scenes/world.hpp"

#include "environment.hpp"
#include "npy_bytes.hpp"
#include "program.hpp"
#include "runs.hpp"

namespace broadcl::test {
namespace {

using nlohmann::json;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float largest = std::numeric_limits<float>::max();

/// A .npy recording of boxes of six numbers.
std::string recording(const std::vector<std::vector<float>>& blocks) {
  std::string data;
  for (const std::vector<float>& block : blocks) data += bytes_of(block);
  return npy("{'descr': '<f4', 'fortran_order': False, 'shape': (" + std::to_string(blocks.size()) + ", " +
                 std::to_string(blocks.front().size() / 6) + ", 6), }\n",
             data);
}

const std::vector<float> four_boxes_apart = {0, 0, 0, 1, 1, 1, 3, 0, 0, 4,  1,  1,  //
                                             6, 0, 0, 7, 1, 1, 9, 9, 9, 10, 10, 10};

class ProgramReplay : public Program {
 protected:
  void SetUp() override {
    write_file(path("rows.npy"), recording({four_boxes_apart, four_boxes, four_boxes_apart, four_boxes}));
    std::vector<float> boxes = four_boxes;
    boxes[8] = std::numeric_limits<float>::quiet_NaN();
    write_file(path("nan.npy"), recording({four_boxes, boxes}));
    boxes[8] = 2;  // above its upper bound
    write_file(path("barely.npy"), recording({four_boxes, four_boxes, boxes}));
  }

  void record(const std::string& options) const {
    expect_success(run("simulate --scenario mixed-sizes --objects 40 --frames 12 --seed 7 " + options));
  }
};

TEST_F(ProgramReplay, RecordHasTheBoxesOfTheBroadPhase) {
  for (const bool spheres : {false, true}) {
    record("--broadphase bullet-bf --record run.aabbs --csv run.csv" +
           std::string(spheres ? " --spheres" : ""));
    const scenes::Scenario::Config config{
        .name = "mixed-sizes", .objects = 40, .seed = 7, .spheres = spheres};
    const auto broadphase = scenes::make_broadphase(
        {.name = "bullet-bf", .device = {}, .objects = 40 + scenes::World::walls, .world_edge = 1});
    scenes::World world(config, *broadphase);
    cli::RecordingReader reader(path("run.aabbs"));
    ASSERT_EQ(reader.boxes(), 40U);
    ASSERT_EQ(reader.frames(), 12U);
    std::vector<std::size_t> pairs;
    for (int block = 0; block <= 12; ++block) {
      if (block > 0) {
        world.step();
        pairs.push_back(world.pair_count());
      }
      const std::vector<Aabb> boxes = reader.next().boxes;
      for (std::size_t k = 0; k < boxes.size(); ++k) {
        const Eigen::AlignedBox3f box = world.box(k);
        const Aabb expected = {{box.min().x(), box.min().y(), box.min().z()},
                               {box.max().x(), box.max().y(), box.max().z()}};
        ASSERT_EQ(boxes[k], expected) << "block " << block << ", object " << k;
      }
    }
    EXPECT_EQ(pairs_in(path("run.csv")), pairs);
  }
}

TEST_F(ProgramReplay, VerifiesAndReports) {
  record("--record run.aabbs");
  for (const std::string broadphase :
       {"bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf", "sweep-and-prune"}) {
    SCOPED_TRACE(broadphase);
    const Outcome outcome =
        run("replay run.aabbs --verify --csv run.csv --json run.json --broadphase " + broadphase);
    expect_success(outcome);
    const std::vector<std::string> parts = {"recording     run.aabbs, 40 boxes, 12 frames\n",
                                            "\nbroad phase   " + broadphase + "\n",
                                            "\nupdate ",
                                            "\ntotal ",
                                            "\nverified ",
                                            "total: their sum"};
    for (const std::string& part : parts) {
      EXPECT_NE(outcome.out.find(part), std::string::npos) << part << " is not in\n" << outcome.out;
    }

    const std::vector<CsvRow> rows = csv_rows(path("run.csv"));
    ASSERT_EQ(rows.size(), 12U);
    for (const CsvRow& row : rows) EXPECT_NEAR(row.total, row.update + row.broad_phase, 3e-6);

    const json summary = json::parse(read_file(path("run.json")));
    const json config = {{"recording", "run.aabbs"},
                         {"objects", 40},
                         {"frames", 12},
                         {"broadphase", broadphase},
                         {"device", ""}};
    EXPECT_EQ(summary["config"], config);
    EXPECT_EQ(summary["device"].is_null(), broadphase != "gpu-bf");
    EXPECT_TRUE(summary["stages"].is_null());
    EXPECT_EQ(summary["pairs"]["last"], rows.back().pairs);
    EXPECT_EQ(summary["verify"]["equal"], true);
    EXPECT_EQ(summary["verify"]["missing_pairs"], 0);
  }
}

/// The walls of the simulation are not recorded, and nothing else is missing.
TEST_F(ProgramReplay, LacksThePairsWithWallsAndSaysSo) {
  const Outcome outcome =
      run("simulate --objects 40 --frames 12 --seed 7 --broadphase bullet-bf --csv run.csv --record run.npy");
  expect_success(outcome);
  EXPECT_NE(outcome.out.find("not the 6 walls around them, so a replay lacks the pairs with the walls.\n"),
            std::string::npos)
      << outcome.out;
  expect_success(run("replay run.npy --broadphase bullet-bf --csv replay.csv"));
  const scenes::Scenario::Config config{.name = "mixed-sizes", .objects = 40, .seed = 7};
  const auto broadphase = scenes::make_broadphase(
      {.name = "bullet-bf", .device = {}, .objects = 40 + scenes::World::walls, .world_edge = 1});
  scenes::World world(config, *broadphase);
  std::vector<std::size_t> with_walls;
  for (int frame = 0; frame < 12; ++frame) {
    world.step();
    const btBroadphasePairArray& pairs = broadphase->getOverlappingPairCache()->getOverlappingPairArray();
    std::size_t count = 0;
    for (int k = 0; k < pairs.size(); ++k) {
      const auto is_wall = [](const btBroadphaseProxy* proxy) {
        return proxy->m_collisionFilterGroup == btBroadphaseProxy::StaticFilter;
      };
      if (is_wall(pairs[k].m_pProxy0) || is_wall(pairs[k].m_pProxy1)) ++count;
    }
    with_walls.push_back(count);
  }
  const std::vector<std::size_t> simulated = pairs_in(path("run.csv"));
  const std::vector<std::size_t> replayed = pairs_in(path("replay.csv"));
  for (std::size_t frame = 0; frame < 12; ++frame) {
    EXPECT_EQ(replayed.at(frame) + with_walls.at(frame), simulated.at(frame)) << "frame " << frame;
  }
  EXPECT_GT(with_walls.back(), 0U);
}

TEST_F(ProgramReplay, SaysWhichBroadPhasesCountMore) {
  write_file(path("rows.npy"), recording({four_boxes_apart, four_boxes_apart}));
  const auto pairs_line = [&](const std::string& broadphase) {
    const std::string out = run("replay rows.npy --broadphase " + broadphase).out;
    const std::size_t begin = out.find("pairs  ");
    return out.substr(begin, out.find('\n', begin) - begin);
  };
  EXPECT_THAT(pairs_line("bullet-bvh"), testing::EndsWith("; bullet-bvh also counts boxes that are apart by "
                                                          "less than its margin"));
  EXPECT_THAT(pairs_line("auto"), testing::EndsWith(", last 0"));
}

TEST_F(ProgramReplay, CountsThePairsOfTheFramesAfterTheFirstState) {
  expect_success(run("replay rows.npy --csv run.csv --broadphase bullet-bf"));
  EXPECT_EQ(pairs_in(path("run.csv")), (std::vector<std::size_t>{2, 0, 2}));
  expect_success(run("replay rows.npy --csv run.csv --broadphase gpu-bf --frames 2"));
  EXPECT_EQ(pairs_in(path("run.csv")), (std::vector<std::size_t>{2, 0}));
}

TEST_F(ProgramReplay, BoxesWithoutBoundsAndPointsAreLegal) {
  std::vector<float> boxes = four_boxes;
  boxes.insert(boxes.end(), {-infinity, -infinity, -infinity, infinity, 0, infinity});
  boxes.insert(boxes.end(), {-largest, -largest, -largest, largest, largest, largest});
  write_file(path("huge.npy"), recording({boxes, boxes}));
  write_file(path("points.npy"), recording({std::vector<float>(60), std::vector<float>(60)}));
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
    for (const std::string file : {"huge.npy", "points.npy"}) {
      SCOPED_TRACE(info.name + " " + file);
      expect_success(run("replay " + file + " --verify --broadphase " + info.name));
    }
  }
}

TEST_F(ProgramReplay, EmptyBoxesAreForThoseThatKnowThem) {
  for (const scenes::BroadphaseInfo& info : scenes::broadphases()) {
    SCOPED_TRACE(info.name);
    const Outcome outcome = run("replay barely.npy --verify --csv run.csv --broadphase " + info.name);
    if (info.bullet) {
      expect_refused(outcome, "'barely.npy' has an empty box, whose min exceeds its max, at frame 2, row 1 ");
      expect_success(run("replay barely.npy --verify --frames 1 --broadphase " + info.name));
    } else {
      expect_success(outcome);
      EXPECT_EQ(pairs_in(path("run.csv")), (std::vector<std::size_t>{2, 0}));
    }
  }
}

/// What the program wrote because of BROADCL_RECORD, which Bullet's adapter obeys. (It has the walls.)
TEST_F(ProgramReplay, ReplaysWhatARunRecorded) {
  expect_success(run("simulate --objects 40 --frames 12 --csv run.csv", "BROADCL_RECORD=run"));
  const std::vector<std::size_t> pairs = pairs_in(path("run.csv"));
  // (It does not record itself, which would overwrite the file.)
  for (const std::string broadphase : {"auto", "bullet-bf", "gpu-bf"}) {
    expect_success(run("replay run --verify --csv run.csv --broadphase " + broadphase, "BROADCL_RECORD=run"));
    EXPECT_EQ(pairs_in(path("run.csv")), pairs) << broadphase;
  }
  const Outcome several = run("replay run --verify --broadphase bullet-bf,tiles,auto");
  expect_success(several);
  EXPECT_THAT(several.out, testing::HasSubstr("recording     run, at most 46 boxes, 12 frames\n"));
  EXPECT_THAT(several.out, testing::HasSubstr("auto          every frame has exactly the pairs"));
  expect_refused(run("replay run --broadphase auto,tiles --csv run.csv"), "--csv and --json are for one");
}

NOT_IN(sanitizers, "waits for another process");
TEST_F(ProgramReplay, ReplaysWhatAProgramRecordedUntilItWasKilled) {
  const ScopedVariable variable("BROADCL_RECORD", path("run").string());
  std::error_code ignored;
  run_until([&] { return fs::file_size(path("run"), ignored) + 1 > 20'000; }, SIGKILL,
            "simulate --objects 40 --frames 1000000 --broadphase sweep-and-prune");
  fs::resize_file(path("run"), 20'000);
  const Outcome outcome = run("replay run --verify");
  expect_success(outcome);
  EXPECT_THAT(outcome.out, testing::HasSubstr("\nverified      every frame has exactly the pairs"));
  EXPECT_THAT(outcome.out, testing::HasSubstr("\nThe recording ends within frame 15, which is left out: "));
}

TEST_F(ProgramReplay, ReplaysWhatBulletDoesNotKnow) {
  {
    const ScopedVariable variable("BROADCL_RECORD", path("run").string());
    BroadPhase broad_phase({.algorithm = "sweep-and-prune"});
    const std::vector<Aabb> boxes(4, Aabb{{0, 0, 0}, {1, 1, 1}});
    broad_phase.add(boxes);
    (void)broad_phase.update();
    broad_phase.set_filter(2, {.world = 7});
    broad_phase.remove(0);
    (void)broad_phase.update();
    BroadPhase64 exact({.algorithm = "sweep-and-prune", .distance = 0.5});
    exact.add(boxes);
    (void)exact.update();
  }
  for (const std::string broadphase : {"auto", "tiles", "gpu-bf", "oracle"}) {
    SCOPED_TRACE(broadphase);
    expect_success(run("replay run --verify --csv run.csv --broadphase " + broadphase));
    EXPECT_EQ(pairs_in(path("run.csv")), (std::vector<std::size_t>{6, 1}));
    expect_success(run("replay run.2 --verify --csv run.csv --broadphase " + broadphase));
    EXPECT_EQ(pairs_in(path("run.csv")), (std::vector<std::size_t>{6}));
  }
  expect_refused(run("replay run --broadphase auto,bullet-bvh"),
                 "'run' has worlds, which bullet-bvh does not");
  expect_refused(run("replay run.2 --broadphase bullet-bvh"), "'run.2' has a distance, which bullet-bvh");
}

TEST_F(ProgramReplay, BadInputIsRefusedAndLeavesNothing) {
  ASSERT_EQ(mkfifo(path("pipe.npy").c_str(), S_IRUSR | S_IWUSR), 0);
  const std::vector<std::string> before = files();
  const auto expect_nothing = [&](const std::string& arguments, const std::string& message) {
    SCOPED_TRACE(arguments);
    expect_refused(run(arguments), message);
    EXPECT_EQ(files(), before);
  };
  expect_nothing("replay", "FILE");
  expect_nothing("replay rows.npy rows.npy", "rows.npy");
  expect_nothing("replay missing.npy", "'missing.npy'");
  expect_nothing("replay 'missing\n.npy'", "'missing .npy'");
  expect_nothing("replay pipe.npy", "'pipe.npy' is not a regular file");
  expect_nothing("replay folder", "'folder' is a directory");
  expect_nothing("replay dangling", "cannot read 'dangling'");
  expect_nothing("replay four.npy", "(frames, n, 6)");
  expect_nothing("replay nan.npy --csv run.csv", "'nan.npy': frame 1, row 1 ");
  expect_nothing("replay rows.npy --frames 4", "'rows.npy' has only 3 frames");
  expect_nothing("replay rows.npy --frames 0", "--frames: '0'");
  expect_nothing("replay rows.npy --broadphase frobnicate --csv run.csv", "bullet-bvh");
  expect_nothing("replay rows.npy --broadphase tiles+culling --csv run.csv", "leave out '+culling'");
  expect_nothing("replay rows.npy --device frobnicate --broadphase bullet-bf", "'frobnicate'");
  expect_nothing("replay rows.npy --csv ./rows.npy", "--csv names the recording itself");
  expect_nothing("replay rows.npy --json folder/../rows.npy", "--json names the recording itself");
  expect_nothing("replay rows.npy --csv run --json ./run", "--csv and --json name the same file");
  expect_nothing("replay rows.npy --csv folder", "'folder' is a directory");
  expect_nothing("replay rows.npy --csv /dev/full --broadphase bullet-bf", "cannot write '/dev/full'");
  expect_nothing("simulate --record run.csv", "ends in .aabbs or .npy");
  expect_nothing("simulate --record missing/run.npy", "missing/run.npy");
  expect_nothing("simulate --csv run.npy --record ./run.npy", "--csv and --record name the same file");
  expect_nothing("simulate --scenario frobnicate --record run.npy", "mixed-sizes");
  expect_nothing("simulate --device frobnicate --record run.npy", "'frobnicate'");
}

}  // namespace
}  // namespace broadcl::test
