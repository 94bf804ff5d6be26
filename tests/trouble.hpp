#pragma once

#include <limits>
#include <new>

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

}  // namespace broadcl::test
