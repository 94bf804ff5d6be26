#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "engines/engine.hpp"
#include "engines/on_device.hpp"
#include "opencl/error.hpp"
#include "opencl/launch.hpp"

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
class DeviceAlgorithm final : public OnDevice {
 public:
  DeviceAlgorithm(const Config& config, const Device& device, std::optional<opencl::Tuning> tuning,
                  MakePairFinder make_finder)
      : OnDevice(config, device, tuning),
        engine_(std::make_unique<Engine>(context_, profiler_, make_finder, Order::Target::host)) {
    objects_ = std::make_unique<DeviceObjects>(context_, profiler_, engine_->frames());
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

  [[nodiscard]] bool uploads_boxes() const noexcept override { return context_.launch().uploads_boxes; }

  void begin(const Input& input) override {
    profiler_.begin();
    context_.guard([&] {
      engine_->prepare();
      engine_->begin(objects_->upload(input));
      objects_->upload_arriving(input);
      engine_->search();
    });
  }

  Delta finish() override {
    const PairDelta::Counts counts = context_.guard([&] { return engine_->finish(); });
    objects_->commit();
    return engine_->changes().on_host(counts);
  }

  [[nodiscard]] Touching touching(AxisSet axes) override {
    return context_.guard([&] { return engine_->touching(axes); });
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

 private:
  std::unique_ptr<Engine> engine_;  // with the frames of the objects
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
