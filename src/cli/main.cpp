#include <broadcl/version.h>
#include <CLI/CLI.hpp>
#include <broadcl/error.hpp>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "cli/process.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"

namespace broadcl::cli {
namespace {

/// "devices, simulate, ... or check".
std::string list_of_verbs(const std::vector<CLI::App*>& verbs) {
  std::string text;
  for (const CLI::App* verb : verbs) {
    if (!text.empty()) text += verb == verbs.back() ? " or " : ", ";
    text += verb->get_name();
  }
  return text;
}

/// The verb that was given, if it is none.
std::optional<std::string> unknown_verb(const CLI::App& program) {
  const std::vector<std::string> rest = program.remaining();
  if (!program.get_subcommands().empty() || rest.empty() || rest.front().starts_with('-')) return {};
  return one_line(rest.front());
}

/// The command that shows help: that of the verb, if one was given.
std::string help_hint(const CLI::App& program) {
  const auto verbs = program.get_subcommands();
  const std::string verb = verbs.empty() ? "" : verbs.front()->get_name() + " ";
  return "; see 'broadcl " + verb + "--help'";
}

std::vector<Verb> add_verbs(CLI::App& program) {
  return {
      add_devices(program),
#ifdef BROADCL_WITH_BULLET
      add_simulate(program), add_replay(program),
#endif
      add_pairs(program),    add_view(program),   add_check(program),
  };
}

Exit run(int argc, const char* const* argv) {
  CLI::App program("Broad-phase collision detection on OpenCL devices.", "broadcl");
  program.set_version_flag("--version", "broadcl " BROADCL_VERSION_STRING);
  program.require_subcommand(0, 1);
  const std::vector<Verb> verbs = add_verbs(program);
  program.set_help_all_flag("--help-all", "Print this and the help of every verb and exit");
  program.get_formatter()->label("SUBCOMMAND", "VERB");
  for (const Verb& verb : verbs) verb.arguments->group("Verbs");
  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& request) {
    program.exit(request);  // prints what --help or --version asked for
    return Exit::success;
  } catch (const CLI::ParseError& error) {
    if (const auto verb = unknown_verb(program)) {
      throw Error("unknown verb '" + *verb + "'; use " + list_of_verbs(program.get_subcommands({})) +
                  help_hint(program));
    }
    throw Error(one_line(error.what()) + help_hint(program));
  }
  for (const Verb& verb : verbs) {
    if (verb.arguments->parsed()) return verb.run();
  }
  throw Error("no verb given; use " + list_of_verbs(program.get_subcommands({})) + help_hint(program));
}

Exit report(const char* error) noexcept {
  std::fprintf(stderr, "broadcl: %s\n", error);
  return Exit::failure;
}

Exit run_and_report(int argc, const char* const* argv) noexcept {
  try {
    const Exit result = run(argc, argv);
    std::cout.flush();
    return std::cout ? result : report("cannot write to standard output");
  } catch (const std::bad_alloc&) {
    return report("out of memory; try fewer objects or boxes");
  } catch (const std::exception& error) {
    return report(error.what());
  } catch (...) {
    return report("unknown error");
  }
}

}  // namespace
}  // namespace broadcl::cli

int main(int argc, char** argv) {
  broadcl::cli::prepare_process();
  return static_cast<int>(broadcl::cli::run_and_report(argc, argv));
}
