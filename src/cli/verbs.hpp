#pragma once

#include <functional>

namespace CLI {
class App;
}

/// The program `broadcl`.
namespace broadcl::cli {

/// How the program ends.
enum class Exit {
  success = 0,
  difference = 1,  ///< A result was computed, and it is wrong.
  failure = 2,     ///< Bad input, or the result could not be computed.
};

/// A verb of the program.
struct Verb {
  CLI::App* arguments;        ///< Owned by the program's parser.
  std::function<Exit()> run;  ///< Called after parsing. For bad input it throws Error and prints nothing.
};

[[nodiscard]] Verb add_devices(CLI::App& program);
[[nodiscard]] Verb add_simulate(CLI::App& program);
[[nodiscard]] Verb add_replay(CLI::App& program);
[[nodiscard]] Verb add_pairs(CLI::App& program);
[[nodiscard]] Verb add_view(CLI::App& program);
[[nodiscard]] Verb add_check(CLI::App& program);

}  // namespace broadcl::cli
