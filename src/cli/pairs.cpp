#include <CLI/CLI.hpp>
#include <algorithm>
#include <broadcl/broad_phase.hpp>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/compiling.hpp"
#include "cli/npy.hpp"
#include "cli/output_file.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"

namespace broadcl::cli {
namespace {

struct Options {
  std::string file;
  std::string out;
  BroadPhase::Config broad_phase{.on_compile = announce_compiling};
};

Exit run(const Options& options) {
  const std::vector<Aabb> boxes = read_boxes(options.file);
  std::optional<OutputFile> out;
  if (!options.out.empty()) {
    std::error_code ignored;
    if (std::filesystem::equivalent(options.file, options.out, ignored)) {
      throw Error("--out names the file of the boxes itself; name another");
    }
    out.emplace(options.out);
  }
  // A device that was asked for must exist, even if the algorithm runs on the host.
  if (!options.broad_phase.device.empty()) (void)select_device(options.broad_phase.device);
  const std::optional<Device> device = device_for(options.broad_phase);
  const std::vector<Pair> pairs = overlapping_pairs(boxes, options.broad_phase);
  if (out) {
    out->write(to_npy(pairs));
    out->commit();
  }
  std::cout << pairs.size() << " overlapping pairs of " << boxes.size() << " boxes ("
            << options.broad_phase.algorithm << " on " << (device ? one_line(device->label()) : "the host")
            << ")\n";
  return Exit::success;
}

}  // namespace

Verb add_pairs(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* verb = program.add_subcommand("pairs", "Find all overlapping pairs of an array of boxes");
  verb->add_option(
          "FILE", options->file,
          "NumPy array (.npy) of shape (n, 6), one row per box: min x, y, z, max x, y, z; float32, or "
          "float64, which is rounded outward")
      ->required()
      ->type_name("");
  add_name(*verb, "--algorithm", options->broad_phase.algorithm, "How to find the pairs; see below");
  add_device(*verb, options->broad_phase.device);
  verb->add_option(
          "--out", options->out,
          "Write the pairs here: .npy, shape (m, 2), uint32, one row per pair: the indices a < b of its "
          "boxes; sorted by b, then by a")
      ->type_name("FILE");
  std::string footer = "Algorithms:\n";
  for (const AlgorithmInfo& algorithm : algorithms()) footer += named_row(algorithm.name, algorithm.summary);
  verb->footer(footer);
  return {verb, [options] { return run(*options); }};
}

}  // namespace broadcl::cli
