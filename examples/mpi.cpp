// Moving boxes on the ranks of an MPI program: how long an update takes, and whether it is right.
//
//   mpirun -n 2 mpi --objects 20000000           cubes at random places, all moving
//   mpirun -n 3 mpi --trace run.aabbs --check    a recording (`broadcl simulate --record`), checked
//
// See usage() for the rest.
#include <mpi.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include <broadcl/broad_phase.hpp>
#include <broadcl/mpi.hpp>

namespace {

using broadcl::Aabb;
using Clock = std::chrono::steady_clock;

void usage() {
  std::puts(
      "usage: mpi [OPTION VALUE]... [--check] [--plain] [--profile]\n"
      "  --objects N      of all ranks together (100000)\n"
      "  --trace FILE     boxes of a recording, .aabbs, instead\n"
      "  --frames N       to play; the first is not measured (20)\n"
      "  --placement P    region: on the rank of their region, except every 20th, which is anywhere "
      "(default);\n"
      "                   random: on any rank\n"
      "  --algorithm A    as broadcl::Config has it (auto)\n"
      "  --device D       likewise; by default the ranks of a node share its GPUs\n"
      "  --threads N      of each rank; by default the ranks of a node share its processors\n"
      "  --check          compares changes with those of one BroadPhase that rank 0 has on the host\n"
      "  --plain          one rank, with a BroadPhase and without the layer for MPI, to compare with\n"
      "  --profile        the stages of an update on each rank");
}

struct Options {
  std::size_t objects = 100000;
  std::string trace{};
  int frames = 20;
  bool random = false;
  bool check = false;
  bool plain = false;
  broadcl::Config config{};
};

template <class Number>
Number number_in(const std::string& text) {
  Number number{};
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || rest != end)
    throw std::runtime_error("not a whole number, or too large: " + text);
  return number;
}

Options read_options(std::span<char*> arguments) {
  Options options;
  for (std::size_t k = 1; k < arguments.size(); ++k) {
    const std::string_view option = arguments[k];
    if (option == "--check") {
      options.check = true;
      continue;
    }
    if (option == "--plain") {
      options.plain = true;
      continue;
    }
    if (option == "--profile") {
      options.config.profile = true;
      continue;
    }
    if (++k == arguments.size())
      throw std::runtime_error("an option lacks its value: " + std::string(option));
    const std::string value = arguments[k];
    if (option == "--objects") {
      options.objects = number_in<std::size_t>(value);
    } else if (option == "--trace") {
      options.trace = value;
    } else if (option == "--frames") {
      options.frames = number_in<int>(value);
    } else if (option == "--placement" && (value == "region" || value == "random")) {
      options.random = value == "random";
    } else if (option == "--algorithm") {
      options.config.algorithm = value;
    } else if (option == "--device") {
      options.config.device = value;
    } else if (option == "--threads") {
      options.config.threads = number_in<std::size_t>(value);
    } else {
      throw std::runtime_error("not understood: " + std::string(option) + " " + value);
    }
  }
  constexpr std::size_t most_objects = std::numeric_limits<std::uint32_t>::max();
  if (options.frames < 1 || options.objects > most_objects) {
    throw std::runtime_error("--frames must be at least 1, --objects at most " +
                             std::to_string(most_objects));
  }
  return options;
}

std::uint64_t mix(std::uint64_t x) {
  x = (x ^ x >> 30U) * 0xbf58476d1ce4e5b9U;
  x = (x ^ x >> 27U) * 0x94d049bb133111ebU;
  return x ^ x >> 31U;
}

/// Boxes of objects 0 .. size()-1, frame by frame.
class Scene {
 public:
  explicit Scene(const Options& options) : size_(options.objects), frames_(options.frames) {
    // Each cube overlaps about four others.
    edge_ = std::cbrt(0.5F / static_cast<float>(std::max<std::size_t>(1, size_)));
    if (!options.trace.empty()) open(options.trace);
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] int frames() const { return frames_; }

  void show(int frame) {
    frame_ = frame;
    if (!file_) return;
    block_.resize(size_);
    file_->seekg(header + static_cast<std::streamoff>(frame) * static_cast<std::streamoff>(size_ * 32));
    file_->read(reinterpret_cast<char*>(block_.data()), static_cast<std::streamsize>(size_ * 32));
    if (!*file_) throw std::runtime_error("the recording ends too early");
  }

  [[nodiscard]] Aabb box(std::size_t object) const {
    if (file_) {
      const Bounds& b = block_[object];
      return {{b[0], b[1], b[2]}, {b[4], b[5], b[6]}};
    }
    // From a random place, at a tenth of its edge per frame along each axis, reflected at the walls.
    Aabb box{};
    std::uint64_t random = mix(object + 1);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float start = static_cast<float>(random >> 40U) * 0x1p-24F;
      random = mix(random + axis);
      const float step = edge_ * (static_cast<float>(random >> 40U) * 0x1p-23F - 1) / 10;
      const float place = std::abs(start + step * static_cast<float>(frame_));
      const float folded = std::fmod(place, 2.0F);
      box.lower[axis] = folded > 1 ? 2 - folded : folded;
      box.upper[axis] = box.lower[axis] + edge_;
    }
    return box;
  }

 private:
  using Bounds = std::array<float, 8>;
  static constexpr std::streamoff header = 128 + 128 + 16 + 32;

  void open(const std::string& name) {
    file_ = std::make_unique<std::ifstream>(name, std::ios::binary);
    std::array<std::int32_t, 2> counts{};
    file_->seekg(256);
    file_->read(reinterpret_cast<char*>(counts.data()), sizeof(counts));
    if (!*file_ || counts[0] < 1 || counts[1] < 1)
      throw std::runtime_error(name + " is no recording (.aabbs)");
    size_ = static_cast<std::size_t>(counts[0]);
    frames_ = std::min(frames_, counts[1]);
  }

  std::size_t size_;
  int frames_;
  int frame_ = 0;
  float edge_;
  std::unique_ptr<std::ifstream> file_;
  std::vector<Bounds> block_;
};

/// Calls function(begin, end) for parts of 0 .. n-1, on all of this rank's processors.
template <class Function>
void in_parts(std::size_t n, std::size_t threads, const Function& function) {
  std::vector<std::jthread> others;
  for (std::size_t k = 0; k < threads; ++k) {
    others.emplace_back([&function, n, k, threads] { function(n * k / threads, n * (k + 1) / threads); });
  }
}

/// A number that depends on which pairs there are, but not on their order.
struct Checksums {
  std::uint64_t added = 0;
  std::uint64_t removed = 0;
  std::uint64_t count = 0;

  template <class Pairs, class ObjectOf>
  static std::uint64_t of(const Pairs& pairs, const ObjectOf& object_of) {
    std::uint64_t sum = 0;
    for (const auto& pair : pairs) {
      const std::uint64_t a = object_of(pair.a);
      const std::uint64_t b = object_of(pair.b);
      sum += mix(mix(std::min(a, b) + 1) + std::max(a, b));
    }
    return sum;
  }
  friend bool operator==(const Checksums&, const Checksums&) = default;
};

double median(std::vector<double> values) {
  std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2));
  return values[values.size() / 2];
}

double seconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Times of frames, each that of the slowest rank.
class Times {
 public:
  void add(std::string_view name, double taken) {
    MPI_Allreduce(MPI_IN_PLACE, &taken, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
    seconds_[std::string(name)].push_back(taken);
  }
  void print() const {
    for (const auto& [name, values] : seconds_)
      std::printf("%-8s %9.3f ms\n", name.c_str(), 1e3 * median(values));
  }

 private:
  std::map<std::string, std::vector<double>> seconds_;
};

/// What the frames of this rank consist of.
class Breakdown {
 public:
  void add(std::span<const broadcl::Stage> stages, std::size_t bytes) {
    std::map<std::string_view, Seconds> frame;
    for (const broadcl::Stage& stage : stages) {
      if (!stages_.contains(stage.name)) names_.push_back(stage.name);
      stages_[stage.name];
      frame[stage.name].host += stage.host_seconds;
      frame[stage.name].device += stage.device_seconds;
    }
    for (const auto& [name, seconds] : frame) {
      stages_[name].host.push_back(seconds.host);
      stages_[name].device.push_back(seconds.device);
    }
    bytes_.push_back(static_cast<double>(bytes));
  }
  [[nodiscard]] std::string text() const {
    if (bytes_.empty()) return {};
    std::string text = "  " + std::to_string(std::llround(median(bytes_))) + " bytes sent\n";
    for (const std::string_view name : names_) {
      const Frames& frames = stages_.at(name);
      std::array<char, 128> line{};
      std::snprintf(line.data(), line.size(), "  %-12s %9.3f ms, device %9.3f ms\n",
                    std::string(name).c_str(), 1e3 * median(frames.host), 1e3 * median(frames.device));
      text += line.data();
      if (frames.host.size() < bytes_.size()) {  // a few frames only: the median is that of those
        text.insert(text.size() - 1, ", in " + std::to_string(frames.host.size()) + " of " +
                                         std::to_string(bytes_.size()) + " frames");
      }
    }
    return text;
  }

 private:
  struct Seconds {
    double host = 0;
    double device = 0;
  };
  struct Frames {
    std::vector<double> host, device;
  };
  std::vector<std::string_view> names_;  // in the order of an update
  std::map<std::string_view, Frames> stages_;
  std::vector<double> bytes_;
};

/// Prints a text of each rank, on rank 0.
void print_in_turn(std::string text) {
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &ranks);
  text.resize(4096);
  std::vector<char> all(rank == 0 ? text.size() * static_cast<std::size_t>(ranks) : 0);
  const int length = static_cast<int>(text.size());
  MPI_Gather(text.data(), length, MPI_CHAR, all.data(), length, MPI_CHAR, 0, MPI_COMM_WORLD);
  for (std::size_t k = 0; k < all.size(); k += text.size()) std::printf("%.*s", length, all.data() + k);
}

class Run {
 public:
  explicit Run(const Options& options) : options_(options), scene_(options) {
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks_);
    if (options.plain && ranks_ > 1) throw std::runtime_error("--plain is for one rank");
    broadcl::Config config = options.config;
    if (config.device.empty()) config.device = broadcl::mpi_device(MPI_COMM_WORLD);
    if (options.plain) {
      plain_.emplace(config);
    } else {
      ranked_.emplace(MPI_COMM_WORLD, config);
    }
    threads_ = config.threads != 0 ? config.threads
                                   : std::max(1U, std::thread::hardware_concurrency() / ranks_on_host());
    if (options.check && rank_ == 0) {
      one_.emplace(broadcl::Config{.algorithm = "sweep-and-prune"});
    }
  }

  /// @returns Whether all was right, as far as it was checked.
  bool play() {
    place();
    bool is_right = true;
    // (The second frame is the first that moves; buffers grow in it.)
    for (int frame = 0; frame <= scene_.frames(); ++frame) is_right = play_frame(frame) && is_right;
    if (rank_ == 0) print(is_right);
    if (options_.config.profile) {
      print_in_turn("rank " + std::to_string(rank_) + ", " + device_name() + ", " +
                    std::to_string(objects_.size()) + " objects\n" + breakdown_.text());
    }
    return is_right;
  }

 private:
  void print(bool is_right) const {
    std::printf("%zu objects, %d ranks%s, %zu threads each, %s, median of %d frames, slowest rank\n",
                scene_.size(), ranks_, options_.plain ? " without the layer for MPI" : "", threads_,
                device_name().c_str(), scene_.frames() - 1);
    times_.print();
    std::printf("%.0f changes per frame%s\n",
                static_cast<double>(changes_) / std::max(1, scene_.frames() - 1),
                !options_.check ? ""
                : is_right      ? ", all of them right"
                                : ", WRONG");
  }

  [[nodiscard]] static unsigned ranks_on_host() {
    MPI_Comm host = MPI_COMM_NULL;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &host);
    int count = 1;
    MPI_Comm_size(host, &count);
    MPI_Comm_free(&host);
    return static_cast<unsigned>(count);
  }

  [[nodiscard]] std::string device_name() const {
    const broadcl::Device* device = plain_ ? plain_->device() : ranked_->device();
    return device != nullptr ? device->label() : "host";
  }

  [[nodiscard]] int random_rank(std::size_t object) const {
    return static_cast<int>(mix(object ^ 0x5555U) % static_cast<std::uint64_t>(ranks_));
  }

  /// Decides which objects are of this rank. Regions are cut for a sample of them first.
  void place() {
    scene_.show(0);
    if (ranks_ > 1) {
      const std::size_t stride = scene_.size() / 200000 + 1;
      for (std::size_t object = 0; object < scene_.size(); object += stride) {
        if (random_rank(object) == rank_) objects_.push_back(static_cast<std::uint32_t>(object));
      }
      write();
      (void)ranked_->update();
      objects_.clear();
    }
    for (std::size_t object = 0; object < scene_.size(); ++object) {
      const bool is_anywhere = options_.random || mix(object) % 20 == 0;
      const int rank = ranks_ == 1   ? 0
                       : is_anywhere ? random_rank(object)
                                     : ranked_->region_of(scene_.box(object).lower);
      if (rank == rank_) objects_.push_back(static_cast<std::uint32_t>(object));
    }
    // With the sample gone, the first frame is all new.
    if (ranks_ > 1) {
      (void)ranked_->map(0);
      (void)ranked_->update();
    }
  }

  void write() {
    const std::span<Aabb> boxes = plain_ ? plain_->map(objects_.size()) : ranked_->map(objects_.size());
    in_parts(objects_.size(), threads_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k)
        boxes[k] = staged_.empty() ? scene_.box(objects_[k]) : staged_[k];
    });
  }

  bool play_frame(int frame) {
    scene_.show(frame);
    // The caller's boxes, which are at hand when the time begins.
    staged_.resize(objects_.size());
    in_parts(objects_.size(), threads_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) staged_[k] = scene_.box(objects_[k]);
    });
    MPI_Barrier(MPI_COMM_WORLD);
    const Clock::time_point start = Clock::now();
    write();
    const Clock::time_point written = Clock::now();
    Checksums sums;
    Clock::time_point end;
    if (plain_) {
      const broadcl::Delta delta = plain_->update();
      end = Clock::now();
      sums = checksums(delta, [](std::uint32_t id) { return id; });
    } else {
      const broadcl::MpiDelta delta = ranked_->update();
      end = Clock::now();
      sums = checksums_of_ranks(delta);
    }
    if (frame > 1) {
      times_.add("= total", seconds(start, end));
      times_.add("= write", seconds(start, written));
      times_.add("= update", seconds(written, end));
      breakdown_.add(plain_ ? plain_->profile() : ranked_->profile(), plain_ ? 0 : ranked_->bytes_sent());
      changes_ += sums.count;
    }
    return !options_.check || is_right(sums);
  }

  template <class Delta, class ObjectOf>
  [[nodiscard]] Checksums checksums(const Delta& delta, const ObjectOf& object_of) const {
    Checksums sums{.count = delta.added.size() + delta.removed.size()};
    if (!options_.check) return sums;
    sums.added = Checksums::of(delta.added, object_of);
    sums.removed = Checksums::of(delta.removed, object_of);
    return sums;
  }

  /// Of all ranks together.
  [[nodiscard]] Checksums checksums_of_ranks(const broadcl::MpiDelta& delta) {
    if (options_.check) gather_objects();
    const Checksums own = checksums(delta, [&](broadcl::MpiId id) {
      return all_objects_[offsets_[static_cast<std::size_t>(broadcl::rank_of(id))] + broadcl::local_id(id)];
    });
    std::array<std::uint64_t, 3> sums{own.added, own.removed, own.count};
    MPI_Allreduce(MPI_IN_PLACE, sums.data(), 3, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    return {.added = sums[0], .removed = sums[1], .count = sums[2]};
  }

  /// Which object each rank has under which id, for the check.
  void gather_objects() {
    if (!all_objects_.empty()) return;
    std::vector<int> counts(static_cast<std::size_t>(ranks_));
    const int own = static_cast<int>(objects_.size());
    MPI_Allgather(&own, 1, MPI_INT, counts.data(), 1, MPI_INT, MPI_COMM_WORLD);
    std::vector<int> offsets;
    int sum = 0;
    for (const int count : counts) {
      offsets.push_back(sum);
      sum += count;
    }
    offsets_.assign(offsets.begin(), offsets.end());
    all_objects_.resize(static_cast<std::size_t>(sum));
    MPI_Allgatherv(objects_.data(), own, MPI_UINT32_T, all_objects_.data(), counts.data(), offsets.data(),
                   MPI_UINT32_T, MPI_COMM_WORLD);
  }

  bool is_right(const Checksums& sums) {
    int is_right = 1;
    if (one_) {
      const std::span<Aabb> boxes = one_->map(scene_.size());
      for (std::size_t k = 0; k < boxes.size(); ++k) boxes[k] = scene_.box(k);
      const Checksums expected = checksums(one_->update(), [](std::uint32_t id) { return id; });
      is_right = sums == expected ? 1 : 0;
    }
    MPI_Bcast(&is_right, 1, MPI_INT, 0, MPI_COMM_WORLD);
    return is_right == 1;
  }

  Options options_;
  Scene scene_;
  int rank_ = 0;
  int ranks_ = 1;
  std::size_t threads_ = 1;
  std::optional<broadcl::MpiBroadPhase> ranked_;
  std::optional<broadcl::BroadPhase> plain_;
  std::optional<broadcl::BroadPhase> one_;  // the check
  std::vector<std::uint32_t> objects_;      // of this rank, by id
  std::vector<Aabb> staged_;
  std::vector<std::uint32_t> all_objects_;  // of all ranks, one after the other
  std::vector<std::size_t> offsets_;        // where those of each begin
  Times times_;
  Breakdown breakdown_;
  std::uint64_t changes_ = 0;
};

int run(std::span<char*> arguments) try {
  if (arguments.size() == 2 && std::string_view(arguments[1]) == "--help") {
    usage();
    return 0;
  }
  return Run(read_options(arguments)).play() ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  MPI_Abort(MPI_COMM_WORLD, 2);
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  const int result = run({argv, static_cast<std::size_t>(argc)});
  MPI_Finalize();
  return result;
}
