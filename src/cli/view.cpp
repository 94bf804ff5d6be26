#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cli/arguments.hpp"
#include "cli/operating_system.hpp"
#include "cli/verbs.hpp"

namespace broadcl::cli {
namespace {

/// What python3 runs. (The first line, so that it imports nothing from the current folder.)
constexpr const char* start_viewer = R"(
import sys; sys.path = [folder for folder in sys.path if folder]
import importlib.util, runpy
if importlib.util.find_spec("broadcl") is None:
    print("broadcl: view needs the Python package, which python3 does not have; docs/install.md "
          "says how to install it", file=sys.stderr)
    sys.exit(2)
runpy.run_module("broadcl", run_name="__main__", alter_sys=True)
)";

struct ViewOptions {
  std::string file;
  std::string out;
};

}  // namespace

Verb add_view(CLI::App& program) {
  auto options = std::make_shared<ViewOptions>();
  CLI::App* verb =
      program.add_subcommand("view", "Make a page in which boxes can be seen, by the Python package");
  verb->add_option("FILE", options->file, "Boxes (.npy, .npz, .csv) or a recording (.aabbs)")
      ->required()
      ->type_name("");
  add_file(*verb, "--out", options->out,
           "Write the page here; default: the name of FILE with .html, in this folder");
  return {verb, [options]() -> Exit {
            std::vector<std::string> arguments{"python3", "-c", start_viewer, "view", options->file};
            if (!options->out.empty()) arguments.insert(arguments.end(), {"--out", options->out});
            replace_process(std::move(arguments));
          }};
}

}  // namespace broadcl::cli
