#include "core/recorder.hpp"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <limits>
#include <map>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <system_error>

namespace broadcl {
namespace {

/// The next file that this process has not named yet: FILE, FILE.2, FILE.3 and so on.
/// @throws std::bad_alloc
std::string next_file(const std::string& file) {
  static std::mutex mutex;
  static auto& named = *new std::map<std::string, unsigned>;  // never destroyed: threads may still need it
  const std::scoped_lock lock(mutex);
  const unsigned number = ++named[file];
  return number == 1 ? file : file + "." + std::to_string(number);
}

}  // namespace

template <class Box>
auto Recorder<Box>::make(double distance) -> std::unique_ptr<Recorder> {
  const auto name = environment("BROADCL_RECORD");
  if (!name) return nullptr;
  std::unique_ptr<Recorder> recorder(new Recorder(*name, distance));
  if (const auto limit = environment("BROADCL_RECORD_LIMIT")) {
    const char* const end = limit->data() + limit->size();
    const auto [stop, error] = std::from_chars(limit->data(), end, recorder->limit_);
    if (error != std::errc() || stop != end)
      recorder->end("BROADCL_RECORD_LIMIT is '" + *limit + "', which is not a number of bytes");
  }
  return recorder;
}

template <class Box>
void Recorder<Box>::write(const Objects& objects, std::span<const Box> boxes,
                          const std::array<const ChangeSet*, 3>& changes,
                          std::span<const Pair> exclusions) noexcept {
  if (is_over_) return;
  try {
    if (!file_ || process_ != process_id()) open();
    if (!is_over_) append_frame(objects, boxes, changes, exclusions);
    if (!is_over_) flush();
  } catch (const std::bad_alloc&) {
    is_over_ = true;
    (void)std::fputs("broadcl: BROADCL_RECORD: memory is exhausted; nothing more is recorded\n", stderr);
  }
}

/// Opens a file and forgets what was in another one.
template <class Box>
void Recorder<Box>::open() {
  do {
    name_ = next_file(first_name_);
    file_ = open_unshared(name_);
  } while (!file_ && errno == EWOULDBLOCK);
  if (!file_) return end("cannot write '" + name_ + "': " + std::generic_category().message(errno));
  process_ = process_id();
  size_ = 0;
  written_.clear();
  exclusions_.clear();
  bytes_ = "BroadCL\n";
  append(std::uint32_t{1}, std::uint32_t{8 * sizeof(Bound)}, distance_, std::uint64_t{0});
}

template <class Box>
void Recorder<Box>::append_frame(const Objects& objects, std::span<const Box> boxes,
                                 const std::array<const ChangeSet*, 3>& changes,
                                 std::span<const Pair> exclusions) {
  constexpr auto infinity = std::numeric_limits<Bound>::infinity();
  const bool is_first = size_ == 0;
  forget_gone(objects, changes);
  bytes_ += "FRAM";
  append(static_cast<std::uint32_t>(objects.size()));
  const std::size_t rest = bytes_.size();
  append(std::uint64_t{0});
  for (std::uint32_t id = 0; id < objects.ids(); ++id) {
    if (objects.contains(id)) append(id);
  }
  for (std::uint32_t id = 0; id < objects.ids(); ++id) {
    if (!objects.contains(id)) continue;
    const bool is_proper = broadcl::is_proper(boxes[id]);
    for (const Bound bound : boxes[id].lower) append(is_proper ? bound : infinity);
    for (const Bound bound : boxes[id].upper) append(is_proper ? bound : -infinity);
  }
  written_.resize(objects.ids());
  append_changed(objects, [&](std::uint32_t id) {
    const auto& [group, mask, body, world] = objects.filter(id);
    if (objects.filter(id) == written_[id].filter) return false;
    append(id, group, mask, body, world);
    written_[id].filter = objects.filter(id);
    return true;
  });
  append_changed(objects, [&](std::uint32_t id) {
    if (distance_ > 0 || objects.reach(id) == written_[id].reach) return false;
    append(id, objects.reach(id));
    written_[id].reach = objects.reach(id);
    return true;
  });
  append(static_cast<std::uint32_t>(gone_.size()));
  for (const std::uint32_t id : gone_) append(id);
  const bool lists_exclusions = is_first || !std::ranges::equal(exclusions, exclusions_);
  append(std::uint32_t{lists_exclusions});
  if (lists_exclusions) {
    append(static_cast<std::uint32_t>(exclusions.size()));
    for (const auto& [a, b] : exclusions) append(a, b);
    exclusions_.assign(exclusions.begin(), exclusions.end());
  }
  store(rest, std::uint64_t{bytes_.size() - rest - sizeof(std::uint64_t)});
  for (std::uint32_t id = 0; id < objects.ids(); ++id) written_[id].is_there = objects.contains(id);
}

/// Finds the objects of the last frame that are not there any more.
template <class Box>
void Recorder<Box>::forget_gone(const Objects& objects, const std::array<const ChangeSet*, 3>& changes) {
  gone_.clear();
  const auto forget = [&](std::uint32_t id) {
    if (id >= written_.size() || !written_[id].is_there) return;
    written_[id] = {};
    gone_.push_back(id);
  };
  for (const ChangeSet* set : changes) std::ranges::for_each(set->recycled(), forget);
  for (std::uint32_t id = 0; id < written_.size(); ++id) {
    if (!objects.contains(id)) forget(id);
  }
  std::ranges::sort(gone_);
}

/// @param append_if_changed Called with each id; returns whether it has appended something.
template <class Box>
template <class Function>
void Recorder<Box>::append_changed(const Objects& objects, const Function& append_if_changed) {
  const std::size_t at = bytes_.size();
  append(std::uint32_t{0});
  std::uint32_t count = 0;
  for (std::uint32_t id = 0; id < objects.ids(); ++id) {
    if (objects.contains(id) && append_if_changed(id)) ++count;
  }
  store(at, count);
}

template <class Box>
template <class... Numbers>
void Recorder<Box>::append(Numbers... numbers) {
  const std::size_t end = bytes_.size();
  bytes_.resize(end + (sizeof(Numbers) + ...));
  std::size_t at = end;
  ((store(at, numbers), at += sizeof(Numbers)), ...);
}

template <class Box>
template <class Number>
void Recorder<Box>::store(std::size_t at, Number number) {
  auto bytes = std::bit_cast<std::array<char, sizeof(Number)>>(number);
  if constexpr (std::endian::native == std::endian::big) std::ranges::reverse(bytes);
  std::ranges::copy(bytes, bytes_.begin() + static_cast<std::ptrdiff_t>(at));
}

template <class Box>
void Recorder<Box>::flush() {
  if (bytes_.size() > limit_ - size_) {
    return end("'" + name_ + "' would exceed " + std::to_string(limit_) + " bytes (BROADCL_RECORD_LIMIT)");
  }
  if (std::fwrite(bytes_.data(), 1, bytes_.size(), file_.get()) != bytes_.size())
    return end("cannot write '" + name_ + "': " + std::generic_category().message(errno));
  size_ += bytes_.size();
  bytes_.clear();
}

template <class Box>
void Recorder<Box>::end(const std::string& why) {
  is_over_ = true;
  file_.reset();
  const std::string line = "broadcl: BROADCL_RECORD: " + why + "; nothing more of this object is recorded\n";
  (void)std::fputs(line.c_str(), stderr);
}

template class Recorder<Aabb>;
template class Recorder<Aabb64>;

}  // namespace broadcl
