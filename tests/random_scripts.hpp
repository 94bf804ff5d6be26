#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <broadcl/error.hpp>

namespace broadcl::test {

/// Ends a script.
[[noreturn]] inline void fail(const std::string& what) {
  throw std::runtime_error(what);
}

inline void require(const ::testing::AssertionResult& result) {
  if (!result) fail(result.message());
}

/// Calls a function that must throw an Error with this text. (Unlike error_of(), this fails the script, not
/// the test.)
template <class Function>
void require_error(std::string_view text, const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    if (std::string_view(error.what()).find(text) != std::string_view::npos) return;
    fail("the wrong error: " + std::string(error.what()));
  }
  fail("no error with the text '" + std::string(text) + "'");
}

/// Random numbers for a script.
class Dice {
 public:
  explicit Dice(const rc::Random& random) : random_(random) {}

  unsigned below(unsigned n) { return static_cast<unsigned>(random_.next() % n); }
  bool one_in(unsigned n) { return below(n) == 0; }
  template <class T, std::size_t N>
  T pick(const std::array<T, N>& values) {
    return values[below(N)];
  }

 private:
  rc::Random random_;
};

/// Shorter and simpler scripts. First it leaves out half of the operations, then a quarter, and so on down to
/// single ones; then it makes one operation simpler. (rapidcheck's own shrinking tries chunks of every
/// length, which takes hours for long scripts.)
/// @tparam plainer_settings Returns the script with simpler settings, perhaps several.
/// @tparam plainer Returns simpler operations of the same kind, the simplest first.
template <class Script, auto plainer_settings, auto plainer>
class Shrinks {
 public:
  explicit Shrinks(Script script)
      : script_(std::move(script)),
        settings_(plainer_settings(script_)),
        chunk_((script_.ops.size() + 1) / 2) {}

  rc::Maybe<Script> operator()() {
    if (!settings_.empty()) {
      Script plain = std::move(settings_.back());
      settings_.pop_back();
      return plain;
    }
    const std::size_t n = script_.ops.size();
    if (chunk_ > 0 && n > 0) {
      Script shorter = script_;
      const auto first = shorter.ops.begin() + static_cast<std::ptrdiff_t>(start_);
      shorter.ops.erase(first, first + static_cast<std::ptrdiff_t>(std::min(chunk_, n - start_)));
      start_ += chunk_;
      if (start_ >= n) {
        start_ = 0;
        chunk_ = chunk_ == 1 ? 0 : (chunk_ + 1) / 2;
      }
      return shorter;
    }
    for (; place_ < n; ++place_, next_ = 0) {
      const auto ops = plainer(script_.ops[place_]);
      if (next_ == ops.size()) continue;
      Script changed = script_;
      changed.ops[place_] = ops[next_++];
      return changed;
    }
    return rc::Nothing;
  }

 private:
  Script script_;
  std::vector<Script> settings_;
  std::size_t chunk_;
  std::size_t start_ = 0;
  std::size_t place_ = 0;
  std::size_t next_ = 0;
};

/// Applies the operations of a script.
template <class Op, class Apply>
void apply_each(const std::vector<Op>& ops, const Apply& apply) {
  for (std::size_t k = 0; k < ops.size(); ++k) {
    try {
      apply(ops[k]);
    } catch (const std::exception& error) {
      fail("operation " + std::to_string(k) + ": " + error.what());
    }
  }
}

/// Whether RC_PARAMS asks for a single script, which failed before.
[[nodiscard]] inline bool is_reproduced() {
  return !rc::detail::configuration().reproduce.empty();
}

/// Always the same in CI, so that a failure is due to the change; long tests look for more.
inline constexpr std::uint64_t seed_of_ci = 1;

/// Fails the test with the shortest script that goes wrong.
/// @param property Draws a script and plays it.
/// @param scripts How many are played.
/// @param seed If none, a different one each time. RC_PARAMS takes precedence.
inline void check_scripts(const std::string& subject, std::size_t scripts, std::optional<std::uint64_t> seed,
                          const std::function<void()>& property) {
  rc::detail::TestParams params = rc::detail::configuration().testParams;
  if (seed && std::getenv("RC_PARAMS") == nullptr) params.seed = *seed;  // NOLINT(concurrency-mt-unsafe)
  params.maxSuccess = static_cast<int>(scripts);
  const auto* const name = testing::UnitTest::GetInstance()->current_test_info()->name();
  const rc::detail::TestResult result =
      rc::detail::checkTestable(property, rc::detail::TestMetadata{.id = name, .description = name}, params);
  std::ostringstream message;
  rc::detail::printResultMessage(result, message);
  EXPECT_TRUE(result.is<rc::detail::SuccessResult>())
      << subject << ", seed " << params.seed << ": " << message.str();
}

}  // namespace broadcl::test
