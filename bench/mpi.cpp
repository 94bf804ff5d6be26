// How much faster several ranks are than one BroadPhase or DeviceBroadPhase:
//
//   mpiexec -n 2 build-dev/bench/broadcl_bench_mpi --objects 20000000
//
// Rank 0 first plays all objects by itself, with all processors of its node. Then all ranks play them
// together, and must find as many changes in each frame, of the same pairs. When the time begins, boxes lie
// in the memory that map() returned, or on the device. Times are medians, those of ranks of the slowest one.
#include "opencl/api.hpp"  // before <CL/cl.h>: it chooses the version

#include <mpi.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>

#include <broadcl/broad_phase.hpp>
#include <broadcl/mpi.hpp>
#include <broadcl/mpi_opencl.hpp>

#include "base/box_parts.hpp"

namespace broadcl::bench {
namespace {

struct Options {
  std::size_t objects = 1000000;
  std::size_t frames = 20;
  std::string placement = "blocks";
  bool profile = false;
  bool on_device = false;
  Config config{};
};

std::uint64_t mix(std::uint64_t x) {
  x = (x ^ x >> 30U) * 0xbf58476d1ce4e5b9U;
  x = (x ^ x >> 27U) * 0x94d049bb133111ebU;
  return x ^ x >> 31U;
}

int world_rank() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}
int world_size() {
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

/// Cubes in the unit cube, each of which overlaps about four others. They move by up to a tenth of their edge
/// per frame and axis, and turn at the walls.
class Scene {
 public:
  explicit Scene(std::size_t objects) : edge_(std::cbrt(0.5F / static_cast<float>(objects))) {}

  [[nodiscard]] Aabb box(std::uint32_t object, std::size_t frame) const {
    Aabb box{};
    std::uint64_t random = mix(object + std::uint64_t{1});
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float start = static_cast<float>(random >> 40U) * 0x1p-24F;
      random = mix(random + axis);
      const float step = edge_ * (static_cast<float>(random >> 40U) * 0x1p-23F - 1) / 10;
      const float at = std::fmod(std::abs(start + step * static_cast<float>(frame)), 2.0F);
      box.lower[axis] = at > 1 ? 2 - at : at;
      box.upper[axis] = box.lower[axis] + edge_;
    }
    return box;
  }

 private:
  float edge_;
};

/// The objects of each rank, and their ids there. A single BroadPhase has those of rank 0 first, then those
/// of rank 1, and so on.
class Placement {
 public:
  Placement(const Options& options, const Scene& scene) : objects_(static_cast<std::size_t>(world_size())) {
    std::array<int, 3> blocks{};
    MPI_Dims_create(world_size(), 3, blocks.data());
    for (std::uint32_t object = 0; object < options.objects; ++object) {
      std::size_t rank = 0;
      if (options.placement == "random") {
        rank = mix(object ^ 0x5555U) % objects_.size();
      } else {
        const Aabb box = scene.box(object, 0);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const auto count = static_cast<std::size_t>(blocks.at(axis));
          const auto at = static_cast<std::size_t>(box.lower[axis] * static_cast<float>(count));
          rank = rank * count + std::min(at, count - 1);
        }
      }
      objects_[rank].push_back(object);
    }
    std::uint64_t offset = 0;
    for (const auto& of_rank : objects_) {
      offsets_.push_back(offset);
      offset += of_rank.size();
    }
  }

  [[nodiscard]] std::span<const std::uint32_t> of(int rank) const {
    return objects_[static_cast<std::size_t>(rank)];
  }
  [[nodiscard]] std::vector<std::uint32_t> all() const {
    std::vector<std::uint32_t> all;
    for (const auto& of_rank : objects_) all.insert(all.end(), of_rank.begin(), of_rank.end());
    return all;
  }
  /// The id that an object of a rank has in a single BroadPhase.
  [[nodiscard]] std::uint64_t id(MpiId id) const {
    return offsets_[static_cast<std::size_t>(rank_of(id))] + local_id(id);
  }

 private:
  std::vector<std::vector<std::uint32_t>> objects_;  // by rank
  std::vector<std::uint64_t> offsets_;               // of the ids of each rank
};

/// The changes of a frame: their number, and a sum that depends on which pairs they are.
struct Changes {
  std::uint64_t count = 0, sum = 0;

  void add(std::uint64_t a, std::uint64_t b, bool is_added) {
    ++count;
    sum += mix(mix(2 * a + (is_added ? 1 : 0)) + b);
  }
  friend bool operator==(const Changes&, const Changes&) = default;
};

struct Run {
  std::vector<double> seconds;   // of each frame
  std::vector<Changes> changes;  // likewise
};

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

template <class Function>
double seconds_of(const Function& function) {
  const auto start = std::chrono::steady_clock::now();
  function();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void write(std::span<Aabb> boxes, std::span<const std::uint32_t> objects, const Scene& scene,
           std::size_t frame) {
  for_each_part(boxes.size(), 0, [&](std::size_t begin, std::size_t end, std::size_t /*thread*/) {
    for (std::size_t k = begin; k < end; ++k) boxes[k] = scene.box(objects[k], frame);
  });
}

/// Medians of the stages of the frames.
class Stages {
 public:
  void add(std::span<const Stage> stages) {
    std::map<std::string_view, double> frame;
    for (const Stage& stage : stages) {
      if (!seconds_.contains(stage.name)) names_.push_back(stage.name);
      seconds_[stage.name];
      frame[stage.name] += stage.host_seconds;
    }
    for (const auto& [name, seconds] : frame) seconds_[name].push_back(seconds);
  }
  void print() const {
    for (const std::string_view name : names_) {
      std::printf("    %-10s %9.3f ms\n", std::string(name).c_str(), 1e3 * median(seconds_.at(name)));
    }
  }

 private:
  std::vector<std::string_view> names_;  // in the order of an update
  std::map<std::string_view, std::vector<double>> seconds_;
};

/// In the first frame everything is new, in the second one buffers grow.
constexpr std::size_t first_measured = 2;

/// Boxes in the memory that map() returns.
template <class Tested>
class OnHost {
 public:
  template <class... Arguments>
  explicit OnHost(const Options& options, const Arguments&... arguments)
      : tested_(arguments..., options.config) {}

  [[nodiscard]] Tested& tested() { return tested_; }
  void write(std::span<const std::uint32_t> objects, const Scene& scene, std::size_t frame) {
    bench::write(tested_.map(objects.size()), objects, scene, frame);
  }
  auto update() { return tested_.update(); }
  [[nodiscard]] std::span<const Pair> read(std::span<const Pair> pairs) const { return pairs; }
  [[nodiscard]] std::string label() const {
    return tested_.device() != nullptr ? tested_.device()->label() : "host";
  }

 private:
  Tested tested_;
};

/// Boxes on the device.
template <class Tested>
class OnDevice {
 public:
  template <class... Arguments>
  explicit OnDevice(const Options& options, const Arguments&... arguments)
      : device_(open(options.config)), tested_(arguments..., queue_(), config_of(options.config)) {}

  [[nodiscard]] Tested& tested() { return tested_; }
  void write(std::span<const std::uint32_t> objects, const Scene& scene, std::size_t frame) {
    boxes_.resize(objects.size());
    bench::write(boxes_, objects, scene, frame);
    const std::size_t bytes = std::max<std::size_t>(1, boxes_.size() * sizeof(Aabb));
    if (buffer_() == nullptr) buffer_ = cl::Buffer(context_, CL_MEM_READ_ONLY, bytes);
    if (!boxes_.empty()) queue_.enqueueWriteBuffer(buffer_, CL_TRUE, 0, bytes, boxes_.data());
  }
  auto update() { return tested_.update({.buffer = buffer_(), .count = boxes_.size()}); }
  [[nodiscard]] std::vector<Pair> read(const DeviceBroadPhase::PairBuffer& pairs) const {
    std::vector<Pair> read(pairs.count);
    if (read.empty()) return read;
    queue_.enqueueReadBuffer(cl::Buffer(pairs.buffer, true), CL_TRUE, 0, read.size() * sizeof(Pair),
                             read.data());
    return read;
  }
  [[nodiscard]] std::string label() const { return tested_.device().label(); }

 private:
  static cl::Device open(const Config& config) {
    const Device device = select_device(config.device);
    std::vector<cl::Platform> platforms;
    cl::Platform::get(&platforms);
    std::vector<cl::Device> devices;
    platforms.at(device.platform).getDevices(CL_DEVICE_TYPE_ALL, &devices);
    return devices.at(device.index);
  }
  static DeviceBroadPhase::Config config_of(const Config& config) { return {.algorithm = config.algorithm}; }

  cl::Device device_;
  cl::Context context_{device_};
  cl::CommandQueue queue_{context_, device_};
  Tested tested_;
  std::vector<Aabb> boxes_;
  cl::Buffer buffer_;
};

template <class Subject>
Run play_alone(const Options& options, const Scene& scene, const Placement& placement) {
  const std::vector<std::uint32_t> objects = placement.all();
  Subject subject(options);
  Run run;
  Stages stages;
  for (std::size_t frame = 0; frame < options.frames + first_measured; ++frame) {
    subject.write(objects, scene, frame);
    decltype(subject.update()) delta;
    const double seconds = seconds_of([&] { delta = subject.update(); });
    Changes changes;
    for (const auto& [a, b] : subject.read(delta.added)) changes.add(a, b, true);
    for (const auto& [a, b] : subject.read(delta.removed)) changes.add(a, b, false);
    run.changes.push_back(changes);
    if (frame < first_measured) continue;
    run.seconds.push_back(seconds);
    stages.add(subject.tested().profile());
  }
  std::printf("alone, %s: %.3f ms\n", subject.label().c_str(), 1e3 * median(run.seconds));
  if (options.profile) stages.print();
  return run;
}

template <class Subject>
Run play_together(const Options& options, const Scene& scene, const Placement& placement) {
  const std::span<const std::uint32_t> objects = placement.of(world_rank());
  Subject subject(options, MPI_COMM_WORLD);
  Run run;
  Stages stages;
  std::vector<double> bytes;
  for (std::size_t frame = 0; frame < options.frames + first_measured; ++frame) {
    subject.write(objects, scene, frame);
    MPI_Barrier(MPI_COMM_WORLD);
    decltype(subject.update()) delta;
    double seconds = seconds_of([&] { delta = subject.update(); });
    Changes changes;
    const auto offset = placement.id(mpi_id(world_rank(), 0));
    for (const auto& [a, b] : subject.read(delta.own.added)) changes.add(offset + a, offset + b, true);
    for (const auto& [a, b] : subject.read(delta.own.removed)) changes.add(offset + a, offset + b, false);
    for (const auto& [a, b] : delta.added) changes.add(placement.id(a), placement.id(b), true);
    for (const auto& [a, b] : delta.removed) changes.add(placement.id(a), placement.id(b), false);
    MPI_Allreduce(MPI_IN_PLACE, &changes.count, 1, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    MPI_Allreduce(MPI_IN_PLACE, &changes.sum, 1, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    run.changes.push_back(changes);
    if (frame < first_measured) continue;
    MPI_Allreduce(MPI_IN_PLACE, &seconds, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
    run.seconds.push_back(seconds);
    stages.add(subject.tested().profile());
    bytes.push_back(static_cast<double>(subject.tested().bytes_sent()));
  }
  if (world_rank() == 0) std::printf("%d ranks: %.3f ms\n", world_size(), 1e3 * median(run.seconds));
  for (int rank = 0; rank < world_size(); ++rank) {
    std::fflush(stdout);
    MPI_Barrier(MPI_COMM_WORLD);
    if (rank != world_rank() || !options.profile) continue;
    std::printf("  rank %d, %s, %zu objects, %.0f bytes sent\n", rank, subject.label().c_str(),
                objects.size(), median(bytes));
    stages.print();
  }
  return run;
}

template <class Alone, class Together>
int run(const Options& options) {
  const Scene scene(options.objects);
  const Placement placement(options, scene);
  Options own = options;
  if (own.config.device.empty()) own.config.device = mpi_device(MPI_COMM_WORLD);
  Run alone;
  if (world_rank() == 0) alone = play_alone<Alone>(own, scene, placement);
  MPI_Barrier(MPI_COMM_WORLD);
  const Run together = play_together<Together>(own, scene, placement);
  if (world_rank() != 0) return 0;
  std::printf(
      "%.2f times as fast; %zu objects, medians of %zu frames, slowest rank, %llu changes per frame\n",
      median(alone.seconds) / median(together.seconds), options.objects, options.frames,
      static_cast<unsigned long long>(together.changes.back().count));
  if (alone.changes == together.changes) return 0;
  std::fprintf(stderr, "the ranks found other changes than one BroadPhase\n");
  return 1;
}

int main(int argc, char** argv) try {
  Options options;
  CLI::App app("How much faster several ranks are than one BroadPhase or DeviceBroadPhase.");
  app.add_option("--objects", options.objects, "of all ranks together")->check(CLI::Range(1U, 1U << 30U));
  app.add_option("--frames", options.frames, "to measure")->check(CLI::PositiveNumber);
  app.add_option("--placement", options.placement,
                 "which objects a rank has: those in its block of space, or any")
      ->check(CLI::IsMember({"blocks", "random"}));
  app.add_option("--algorithm", options.config.algorithm);
  app.add_option("--device", options.config.device, "by default the ranks of a node share its GPUs");
  app.add_option("--threads", options.config.threads, "of each rank, and if there is only one");
  app.add_flag("--on-device", options.on_device, "boxes are on the device, and changes stay there");
  app.add_flag("--profile", options.profile, "print the stages of an update");
  CLI11_PARSE(app, argc, argv);
  if (options.on_device) return run<OnDevice<DeviceBroadPhase>, OnDevice<MpiDeviceBroadPhase>>(options);
  return run<OnHost<BroadPhase>, OnHost<MpiBroadPhase>>(options);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  MPI_Abort(MPI_COMM_WORLD, 2);
  return 2;
}

}  // namespace
}  // namespace broadcl::bench

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  const int result = broadcl::bench::main(argc, argv);
  MPI_Finalize();
  return result;
}
