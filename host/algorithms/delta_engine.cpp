#include "algorithms/delta_engine.hpp"

#include <utility>

#include "algorithms/device_objects.hpp"
#include "algorithms/pair_delta.hpp"
#include "algorithms/scoped_timer.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

class DeltaEngine final : public Algorithm {
  /// Runs a part of an update, and adds up its time. Where it fails, nothing uses the boxes any more.
  template <class Function>
  auto guard(Function&& function) {
    const ScopedTimer timer(seconds_);
    return opencl::translate_errors(context_.device().label(), [&] {
      try {
        return std::forward<Function>(function)();
      } catch (...) {
        opencl::wait_after_failure(context_.queue());
        throw;
      }
    });
  }

 public:
  DeltaEngine(const BroadPhase::Config& config, MakePairFinder make_finder)
      : context_(select_device(config.device), config.profile),
        profiler_(config.profile),
        objects_(context_, profiler_),
        delta_(context_, profiler_),
        finder_(make_finder(context_)) {}

  void reserve(std::size_t boxes) override { objects_.reserve(boxes); }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return objects_.boxes(); }

  void begin(const Changes& changes) override {
    profiler_.begin();
    seconds_ = 0;
    guard([&] {
      const Search search = objects_.upload(changes);
      // NOLINTNEXTLINE(bugprone-exception-escape): handles do not throw when moved
      delta_.begin({.search = search, .find = [this, search] { finder_->find(search, delta_, profiler_); }});
    });
  }

  void flush() override {
    guard([&] { context_.queue().flush(); });
  }

  Delta finish() override {
    const Delta delta = guard([&] { return delta_.finish(); });
    objects_.commit();
    finder_->ended(seconds_);
    return delta;
  }

  [[nodiscard]] std::vector<Pair> pairs() const override {
    return opencl::translate_errors(context_.device().label(), [&] { return delta_.pairs(); });
  }

  [[nodiscard]] const Device* device() const noexcept override { return &context_.device(); }
  [[nodiscard]] MemoryUse memory() const noexcept override { return context_.memory(); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return profiler_.stages(); }

 private:
  opencl::Context context_;
  opencl::Profiler profiler_;
  DeviceObjects objects_;
  PairDelta delta_;
  std::unique_ptr<PairFinder> finder_;
  double seconds_ = 0;  // of the update so far
};

}  // namespace

std::unique_ptr<Algorithm> make_delta_engine(const BroadPhase::Config& config, MakePairFinder make_finder) {
  return std::make_unique<DeltaEngine>(config, make_finder);
}

}  // namespace broadcl
