#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>

namespace broadcl {

/// What a search has to do.
struct Work {
  std::size_t slots = 0;
  std::size_t changed = 0;  ///< Slots that changed; all of them where `all`.
  bool all = true;

  /// Pairs of which one slot at least changed, roughly.
  [[nodiscard]] double tests() const noexcept;
};

/// What a search costs an algorithm, in seconds. Only their ratios count: what one costs tells the speed of
/// the device.
struct CostModel {
  double frame = 0;   ///< Whatever there is to do.
  double slot = 0;    ///< For each slot.
  double change = 0;  ///< For each slot that changed.
  double test = 0;    ///< For each of Work::tests().

  [[nodiscard]] double seconds(const Work& work) const noexcept;
};

/// Chooses between two algorithms, frame by frame, by what frames cost.
///
/// Searches whose numbers of slots, and of slots that changed, are alike to a power of two are one situation.
/// In each the one that was cheaper is asked; once in a while the other one is tried, ever more rarely, and
/// so that tries take a small part of the time. One that costs more than `hopeless` times the other by the
/// models is never asked, and a try ends with the first frame that does.
class Chooser {
 public:
  static constexpr double hopeless = 4;

  explicit Chooser(const std::array<CostModel, 2>& models) : models_(models) {}

  /// Which of the two is to do a search, 0 or 1.
  [[nodiscard]] std::size_t choose(const Work& work);
  /// What the last search cost that was chosen for. May be left out, where that is not known or was out of
  /// the ordinary.
  void learn(double seconds);

 private:
  /// The last costs in a situation, as multiples of the model's.
  class Costs {
   public:
    void add(double cost) noexcept;
    void clear() noexcept { count_ = 0; }
    /// The median, which a single frame out of the ordinary does not move.
    [[nodiscard]] std::optional<double> typical() const noexcept;

   private:
    std::array<double, 3> last_{};
    std::size_t count_ = 0;  // ever added
  };

  struct Situation {
    std::size_t best = 0;
    std::array<Costs, 2> costs;
    std::optional<std::size_t> asked;  // in the last frame of this situation
    std::size_t trial = 0;             // frames that the other one is still to be tried for
    std::size_t since = 0;             // frames since it was
    std::size_t interval = 16;         // frames until the next trial, at the least
  };

  [[nodiscard]] double expected(std::size_t candidate, const Situation& situation, const Work& work) const;
  /// The one that is never asked for this.
  [[nodiscard]] std::optional<std::size_t> hopeless_one(const Work& work) const;

  std::array<CostModel, 2> models_;
  std::map<std::pair<std::size_t, std::size_t>, Situation> situations_;
  std::array<std::optional<double>, 2> anywhere_;  // the last typical cost in any situation
  Work work_;                                      // of the last search
  Situation* situation_ = nullptr;                 // its own
  std::size_t chosen_ = 0;
};

}  // namespace broadcl
