#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "engines/device_objects.hpp"
#include "engines/engine.hpp"
#include "opencl/context.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"
#include "opencl/profiler.hpp"

namespace broadcl {
namespace {

/// How many pairs to reserve memory for in a search of boxes that nothing is known about, so that few have to
/// run twice. (Only on CPUs, because they do not use memory before something is written there.)
std::size_t expected_pairs(const Device& device, std::size_t slots) {
  constexpr std::size_t per_box = 128;
  constexpr std::uint64_t most_bytes = 256 << 20;
  if (device.type != DeviceType::cpu) return 0;
  const std::uint64_t bytes = std::min({most_bytes, device.max_allocation, device.memory / 16});
  return std::min(per_box * slots, static_cast<std::size_t>(bytes / sizeof(Pair)));
}

/// The engine with objects from the host and changes for the host.
class DeviceAlgorithm final : public Algorithm {
 public:
  DeviceAlgorithm(const Config& config, const Device& device, std::optional<opencl::Tuning> tuning,
                  MakePairFinder make_finder)
      : context_(device, config.profile, config.on_compile, tuning),
        profiler_(config.profile),
        engine_(std::make_unique<Engine>(context_, profiler_, make_finder, Order::Target::host)),
        objects_(std::make_unique<DeviceObjects>(context_, profiler_, engine_->frames())) {}

  void reserve(std::size_t slots, bool filters) override {
    context_.guard([&] { objects_->reserve(slots, filters); });
  }

  void reserve_exclusions(std::size_t count) override {
    context_.guard([&] { objects_->reserve_exclusions(count); });
  }

  void shrink(std::size_t slots) override {
    context_.guard([&] {
      auto engine = engine_->successor();
      auto objects = objects_->successor(slots, engine->frames());
      objects_ = std::move(objects);
      engine_ = std::move(engine);
      opencl::wait_if_possible(context_.queue());
    });
  }

  [[nodiscard]] std::span<Aabb> boxes() noexcept override { return objects_->boxes(); }
  [[nodiscard]] std::span<Aabb> spare_boxes() override {
    return context_.guard([&] { return objects_->spare_boxes(); });
  }
  void swap_boxes() noexcept override { objects_->swap_boxes(); }
  [[nodiscard]] std::shared_ptr<const void> boxes_owner() const override { return objects_->boxes_owner(); }

  [[nodiscard]] bool uploads_boxes() const noexcept override { return context_.launch().uploads_boxes; }

  void begin(const Input& input) override {
    profiler_.begin();
    listener_ = input.listener;
    context_.guard([&] {
      engine_->prepare();
      engine_->begin(objects_->upload(input));
      objects_->upload_arriving(input);
      engine_->search();
    });
  }

  void flush() override {
    context_.guard([&] { context_.queue().flush(); });
  }

  Delta finish() override {
    const PairDelta::Counts counts = context_.guard([&] { return engine_->finish(listener_); });
    objects_->commit();
    return engine_->changes().on_host(counts);
  }

  [[nodiscard]] std::vector<Pair> find_all(const Input& input) override {
    profiler_.begin();
    return context_.guard([&] {
      engine_->prepare(expected_pairs(context_.device(), input.boxes.size()));
      engine_->begin(objects_->upload(input));
      engine_->search();
      return engine_->finish_only_search();
    });
  }

  [[nodiscard]] double expected_seconds(std::size_t slots, std::size_t changed) const override {
    return engine_->expected_seconds(slots, changed);
  }

  [[nodiscard]] std::vector<Pair> pairs() override {
    return context_.guard([&] { return engine_->pairs(); });
  }

  [[nodiscard]] const Device* device() const noexcept override { return &context_.device(); }
  [[nodiscard]] MemoryUse memory() const noexcept override { return context_.memory(); }
  [[nodiscard]] std::span<const Stage> profile() const noexcept override { return profiler_.stages(); }

 private:
  opencl::Context context_;
  opencl::Profiler profiler_;
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<DeviceObjects> objects_;  // in its frames
  PairListener* listener_ = nullptr;        // of the update that was begun
};

}  // namespace

AlgorithmPointer make_device_algorithm(const Config& config, MakePairFinder make_finder) {
  const Device device = select_device(config.device);
  return opencl::translate_errors(device.label(), [&] {
    return opencl::make_tuned([&](std::optional<opencl::Tuning> tuning) {
      return std::make_unique<DeviceAlgorithm>(config, device, tuning, make_finder);
    });
  });
}

}  // namespace broadcl
