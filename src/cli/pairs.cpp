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
#include "cli/box_file.hpp"
#include "cli/compiling.hpp"
#include "cli/output_file.hpp"
#include "cli/stopwatch.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"

namespace broadcl::cli {
namespace {

struct PairsOptions {
  std::string file;
  std::string out;
  BroadPhase::Config broad_phase{.on_compile = announce_compiling};
};

void warn_of_inverted(const BoxView& boxes) {
  const InvertedBoxes inverted = boxes.inverted();
  if (inverted.count == 0) return;
  std::string what_to_do = "infinity > -infinity on each axis is a box that is meant to be empty";
  if (inverted.likely == BoxLayout::axes) {
    what_to_do = "are the columns min x, max x, min y, ...? Give min x, y, z, max x, y, z";
  } else if (inverted.likely == BoxLayout::centre_size) {
    what_to_do = "are the columns a centre and a size? Give min x, y, z, max x, y, z";
  }
  std::cerr << "broadcl: warning: inverted boxes (min > max), which overlap nothing: " << inverted.count
            << " of " << boxes.size() << " rows, the first of them row " << inverted.first << "; "
            << what_to_do << "\n";
}

Exit run_pairs(const PairsOptions& options) {
  std::optional<OutputFile> out;
  if (!options.out.empty()) {
    const std::filesystem::path path = options.out;
    if (path.has_extension() && path.extension() != ".npy") {
      throw Error("--out: pairs are written as .npy, not as " + one_line(path.extension().string()) + ": " +
                  quoted(path));
    }
    std::error_code ignored;
    if (std::filesystem::equivalent(options.file, options.out, ignored)) {
      throw Error("--out names the file of the boxes itself; name another");
    }
    out.emplace(options.out);
  }
  constexpr int decimals = 3;
  Stopwatch stopwatch;
  const FileBoxes file = read_boxes(options.file);
  const BoxView boxes = file.view();
  std::string times = "reading " + fixed(stopwatch.lap(), decimals) + " s";
  warn_of_inverted(boxes);
  // A device that was asked for must exist, even if the algorithm runs on the host.
  if (!options.broad_phase.device.empty()) (void)select_device(options.broad_phase.device);
  const std::optional<Device> device = device_for(options.broad_phase);
  const std::vector<Pair> pairs = overlapping_pairs(boxes, {}, options.broad_phase);
  times += ", searching " + fixed(stopwatch.lap(), decimals) + " s";
  if (out) {
    out->write(to_npy(pairs));
    out->commit();
    times += ", writing " + fixed(stopwatch.lap(), decimals) + " s";
  }
  std::cout << counted(pairs.size(), "overlapping pair") << " of " << counted(boxes.size(), "box") << " ("
            << options.broad_phase.algorithm << " on " << (device ? one_line(device->label()) : "the host")
            << ")\n";
  std::cout << times << (device ? "; searching includes opening the device" : "") << "\n";
  return Exit::success;
}

}  // namespace

Verb add_pairs(CLI::App& program) {
  auto options = std::make_shared<PairsOptions>();
  CLI::App* verb = program.add_subcommand("pairs", "Find all overlapping pairs of an array of boxes");
  verb->add_option(
          "FILE", options->file,
          "NumPy array (.npy, or .npz with one array or one that is called boxes) of shape (n, 6), one "
          "row per box: min x, y, z, max x, y, z; or (n, 4) in two dimensions: min x, y, max x, y; "
          "float32 or float64, whose pairs are exact. Or text (.csv): a box per line, the same "
          "numbers separated by commas, semicolons or spaces. - is standard input")
      ->required()
      ->type_name("");
  add_name(*verb, "--algorithm", options->broad_phase.algorithm,
           "The algorithm that finds the pairs; see below");
  add_device(*verb, options->broad_phase.device);
  add_file(*verb, "--out", options->out,
           "Write the pairs here: .npy, shape (m, 2), uint32, one row per pair: the indices a < b of its "
           "boxes; sorted by b, then by a");
  std::string footer = "Algorithms:\n";
  for (const AlgorithmInfo& algorithm : algorithms()) footer += named_row(algorithm.name, algorithm.summary);
  verb->footer(footer);
  return {verb, [options] { return run_pairs(*options); }};
}

}  // namespace broadcl::cli
