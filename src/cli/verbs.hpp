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
  difference = 1,  ///< Something was computed, and it is not what it must be.
  failure = 2,     ///< Bad input, or no way to compute.
};

/// A verb of the program.
struct Verb {
  CLI::App* arguments;  ///< Owned by the program's parser.
  std::function<Exit()>
      run;  ///< Call it after parsing. Throws Error before it prints anything for bad input.
};

[[nodiscard]] Verb add_devices(CLI::App& program);
[[nodiscard]] Verb add_simulate(CLI::App& program);
[[nodiscard]] Verb add_replay(CLI::App& program);
[[nodiscard]] Verb add_pairs(CLI::App& program);
[[nodiscard]] Verb add_check(CLI::App& program);
[[nodiscard]] Verb add_study(CLI::App& program);

}  // namespace broadcl::cli
