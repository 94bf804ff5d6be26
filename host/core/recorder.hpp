#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/filter.hpp>
#include <broadcl/pair.hpp>

#include "base/packed_box.hpp"
#include "base/system.hpp"
#include "core/change_set.hpp"
#include "core/object_table.hpp"

namespace broadcl {

/// Writes the objects of each update to a file, in the form that docs/recording.md describes. What goes wrong
/// is a line on stderr, and the end of the recording.
template <class Box>
class Recorder {
 public:
  using Bound = BoundType<Box>;
  using Objects = ObjectTable<Bound>;

  /// @param distance Config::distance.
  /// @returns What BROADCL_RECORD asks for; null if it is unset.
  /// @throws std::bad_alloc
  [[nodiscard]] static std::unique_ptr<Recorder> make(double distance);

  /// Writes the next frame. The first one opens the file.
  /// @param boxes By id, packed.
  /// @param changes Together, what changed since the last frame.
  /// @param exclusions In canonical order.
  void write(const Objects& objects, std::span<const Box> boxes,
             const std::array<const ChangeSet*, 3>& changes, std::span<const Pair> exclusions) noexcept;

 private:
  /// An object as the file has it.
  struct Written {
    bool is_there = false;
    Filter filter{};
    Bound reach = 0;
  };

  Recorder(std::string name, double distance) : first_name_(std::move(name)), distance_(distance) {}

  void open();
  void append_frame(const Objects& objects, std::span<const Box> boxes,
                    const std::array<const ChangeSet*, 3>& changes, std::span<const Pair> exclusions);
  void forget_gone(const Objects& objects, const std::array<const ChangeSet*, 3>& changes);
  template <class... Numbers>
  void append(Numbers... numbers);
  template <class Number>
  void store(std::size_t at, Number number);
  template <class Function>
  void append_changed(const Objects& objects, const Function& append_if_changed);
  void flush();
  void end(const std::string& why);

  std::string first_name_;
  std::string name_;  // of the file
  double distance_;
  std::uint64_t limit_ = std::uint64_t{1} << 30U;
  File file_;
  std::uint32_t process_ = 0;  // that opened it
  bool is_over_ = false;
  std::uint64_t size_ = 0;  // of the file
  std::vector<Written> written_;
  std::vector<std::uint32_t> gone_;
  std::vector<Pair> exclusions_;  // as the file has them
  std::string bytes_;             // that are not written yet
};

extern template class Recorder<Aabb>;
extern template class Recorder<Aabb64>;

}  // namespace broadcl
