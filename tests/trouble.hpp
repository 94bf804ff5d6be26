#pragma once

#include <algorithm>
#include <limits>
#include <new>
#include <optional>

#include <gtest/gtest.h>

#include <broadcl/error.hpp>

namespace broadcl::test {

/// Makes something fail while calls under test run, and only then.
/// @tparam Failing FailingOpenCl or FailingAllocations. @tparam counted What it counts.
template <class Failing, long (*counted)() noexcept>
class Trouble {
 public:
  static constexpr long for_good = std::numeric_limits<long>::max() / 2;

  /// @param first How many succeed before. @param count How many fail then.
  Trouble(long first, long count) : first_(first), count_(count) {}

  /// Repeats a call that fails. After two failures, nothing fails any more.
  /// @param after_failure Called after each failure; nothing fails meanwhile.
  template <class Function, class AfterFailure>
  auto call(const Function& function, const AfterFailure& after_failure) {
    for (int failures = 0;; ++failures) {
      if (failures == 2) count_ = 0;
      try {
        const Armed armed(*this);
        return function();
      } catch (const Error&) {
        if (failures > 2) throw;
      } catch (const std::bad_alloc&) {
        if (failures > 2) throw;
      }
      ++failures_;
      after_failure();
    }
  }

  /// How often something might have failed.
  [[nodiscard]] long points() const { return made_; }
  [[nodiscard]] int failures() const { return failures_; }

 private:
  class Armed {
   public:
    explicit Armed(Trouble& trouble)
        : trouble_(trouble), failing_(trouble.first_ - trouble.made_, trouble.count_) {}
    ~Armed() { trouble_.made_ += counted(); }
    Armed(const Armed&) = delete;
    Armed& operator=(const Armed&) = delete;
    Armed(Armed&&) = delete;
    Armed& operator=(Armed&&) = delete;

   private:
    Trouble& trouble_;
    Failing failing_;
  };

  long first_;
  long count_;
  long made_ = 0;
  int failures_ = 0;
};

/// Runs one life in which nothing fails, then one for each point at which something may fail.
/// @param most If there are more points, about this many, evenly spread.
/// @param live Takes the point that fails first, and returns how many points there were, or none after a
/// wrong answer.
template <class Function>
void expect_right_lives(long most, const Function& live) {
  const std::optional<long> points = live(std::numeric_limits<long>::max());
  ASSERT_TRUE(points) << "although nothing fails";
  const long step = std::max(1L, (*points + most - 1) / most);
  for (long first = 0; first < *points; first += step) {
    ASSERT_TRUE(live(first)) << "failure " << first << " of " << *points;
  }
}

/// Options of a life.
struct Habits {
  /// Whether it looks at all pairs after each failure, which might also repair what the failure broke.
  bool looks = false;
  /// Whether objects get worlds, for which some algorithms build a kernel in the middle of a life.
  bool worlds = false;
  /// Updates at the beginning in which one object moves.
  int updates = 0;
};

}  // namespace broadcl::test
