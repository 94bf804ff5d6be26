#include "cli/box_file.hpp"

#include <algorithm>
#include <broadcl/error.hpp>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iostream>
#include <istream>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "cli/input_file.hpp"
#include "cli/operating_system.hpp"
#include "cli/text.hpp"

namespace broadcl::cli {
namespace {

struct Line {
  std::vector<double> numbers;
  bool has_words = false;
};

Line parsed(std::string_view line) {
  constexpr std::string_view separators = ",; \t\r";
  Line result;
  for (std::size_t at = 0; (at = line.find_first_not_of(separators, at)) != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(separators, at), line.size());
    if (line[at] == '+') ++at;
    double number = 0;
    const auto [stop, error] = std::from_chars(line.data() + at, line.data() + end, number);
    if (error == std::errc() && stop == line.data() + end) {
      result.numbers.push_back(number);
    } else {
      result.has_words = true;
    }
    at = end;
  }
  return result;
}

FileBoxes read_text(std::istream& stream) {
  FileBoxes boxes;
  std::vector<double> all;
  std::size_t line_number = 0;
  for (std::string line; std::getline(stream, line);) {
    const std::string where = "line " + std::to_string(++line_number);
    const auto [numbers, has_words] = parsed(std::string_view(line).substr(0, line.find('#')));
    if (has_words && numbers.empty() && line_number == 1) continue;  // a heading
    if (has_words) throw Error(where + " has something other than numbers: " + one_line(line.substr(0, 100)));
    if (numbers.empty()) continue;
    if (all.empty()) boxes.columns = numbers.size();
    if (numbers.size() != boxes.columns || (boxes.columns != 6 && boxes.columns != 4)) {
      throw Error(where + " has " + counted(numbers.size(), "number") + "; " +
                  (all.empty() ? std::string("4 or 6 are needed: ") + box_columns_text
                               : "the first box has " + std::to_string(boxes.columns)));
    }
    if (std::ranges::any_of(numbers, [](double number) { return std::isnan(number); }))
      throw Error(where + " has a NaN; remove it or give it bounds");
    all.insert(all.end(), numbers.begin(), numbers.end());
  }
  boxes.numbers = std::move(all);
  return boxes;
}

/// A number of an archive.
/// @throws Error if there are not so many bytes.
std::uint64_t number_at(std::string_view archive, std::uint64_t at, unsigned size) {
  if (at > archive.size() || archive.size() - at < size) throw Error("the archive is damaged");
  std::uint64_t number = 0;
  for (unsigned k = 0; k < size; ++k)
    number |= std::uint64_t{static_cast<unsigned char>(archive[static_cast<std::size_t>(at) + k])} << (8 * k);
  return number;
}

std::string_view part_of(std::string_view archive, std::uint64_t at, std::uint64_t size) {
  if (at > archive.size() || archive.size() - at < size) throw Error("the archive is damaged");
  return archive.substr(static_cast<std::size_t>(at), static_cast<std::size_t>(size));
}

struct ArchiveMember {
  std::string_view name;
  std::string_view bytes;
  bool is_compressed;
};

/// The members of a .zip, as "APPNOTE.TXT - .ZIP File Format Specification" describes them.
std::vector<ArchiveMember> members_of(std::string_view archive) {
  constexpr std::string_view end_magic("PK\5\6");
  constexpr std::string_view entry_magic("PK\1\2");
  constexpr std::uint64_t elsewhere = 0xffffffff;  // in the extra field of 64-bit numbers
  const std::size_t end = archive.rfind(end_magic);
  if (end == std::string_view::npos) throw Error("it is truncated: the directory of the archive is missing");
  std::vector<ArchiveMember> members;
  const std::uint64_t count = number_at(archive, end + 10, 2);
  std::uint64_t at = number_at(archive, end + 16, 4);
  for (std::uint64_t k = 0; k < count; ++k) {
    if (part_of(archive, at, 4) != entry_magic) throw Error("the archive is damaged");
    const std::uint64_t name_size = number_at(archive, at + 28, 2);
    const std::uint64_t extra_size = number_at(archive, at + 30, 2);
    std::uint64_t size = number_at(archive, at + 20, 4);
    std::uint64_t begin = number_at(archive, at + 42, 4);
    const std::string_view extra = part_of(archive, at + 46 + name_size, extra_size);
    for (std::uint64_t field = 0; field < extra.size();) {
      std::uint64_t value = field + 4;
      if (number_at(extra, field, 2) == 1) {
        if (number_at(archive, at + 24, 4) == elsewhere) value += 8;
        if (size == elsewhere) size = number_at(extra, std::exchange(value, value + 8), 8);
        if (begin == elsewhere) begin = number_at(extra, value, 8);
      }
      field += 4 + number_at(extra, field + 2, 2);
    }
    const std::uint64_t before = 30 + number_at(archive, begin + 26, 2) + number_at(archive, begin + 28, 2);
    members.push_back({.name = part_of(archive, at + 46, name_size),
                       .bytes = part_of(archive, begin + before, size),
                       .is_compressed = number_at(archive, at + 10, 2) != 0});
    at += 46 + name_size + extra_size + number_at(archive, at + 32, 2);
  }
  return members;
}

FileBoxes read_archive(std::istream& stream) {
  std::ostringstream all;
  all << stream.rdbuf();
  const std::string archive = std::move(all).str();
  const std::vector<ArchiveMember> members = members_of(archive);
  const auto boxes = std::ranges::find(members, "boxes.npy", &ArchiveMember::name);
  if (members.size() != 1 && boxes == members.end()) {
    throw Error("it has " + counted(members.size(), "array") +
                ", none of which is called boxes; save one with numpy.savez(file, boxes=...)");
  }
  const ArchiveMember& member = boxes != members.end() ? *boxes : members.front();
  if (member.is_compressed) throw Error("its arrays are compressed; save it with numpy.savez or numpy.save");
  std::istringstream array{std::string(member.bytes)};
  return read_boxes(array);
}

FileBoxes read_any(std::istream& stream, bool is_array) {
  switch (stream.peek()) {
    case 'P':
      return read_archive(stream);
    case 0x93:
      return read_boxes(stream);
    default:
      return is_array ? read_boxes(stream) : read_text(stream);
  }
}

}  // namespace

FileBoxes read_boxes(const std::filesystem::path& file) {
  const bool is_standard_input = file == "-";
  std::ifstream opened;
  if (is_standard_input) {
    make_standard_input_binary();
  } else {
    opened = open_input(file);
  }
  try {
    return read_any(is_standard_input ? std::cin : opened,
                    file.extension() == ".npy" || file.extension() == ".npz");
  } catch (const Error& error) {
    throw Error("cannot use " + (is_standard_input ? "standard input" : quoted(file)) + ": " + error.what());
  }
}

}  // namespace broadcl::cli
