#include "opencl/kernel_source.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include <broadcl/error.hpp>

#include "base/system.hpp"

namespace broadcl::opencl {
namespace {

std::string read(std::string_view name) {
  if (const auto folder = environment("BROADCL_KERNEL_DIR")) {
    const auto path = std::filesystem::path(*folder) / name;
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    if (!(text << file.rdbuf())) {
      throw Error("cannot read " + path.string() +
                  "; set BROADCL_KERNEL_DIR to the folder with BroadCL's kernels, or unset it");
    }
    return std::move(text).str();
  }
  const auto files = embedded_kernel_files();
  const auto file =
      std::find_if(files.begin(), files.end(), [&](const KernelFile& f) { return f.name == name; });
  if (file == files.end()) throw Error("there is no kernel file named " + std::string(name));
  return std::string(file->text);
}

/// The first line of a text, which is removed from it. (std::getline would take a failed allocation for the
/// end of the text.)
std::string_view next_line(std::string_view& text) {
  const std::size_t end = text.find('\n');
  const std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  return line;
}

/// The text between the first two quotation marks of a line.
std::string_view quoted(std::string_view line) {
  line.remove_prefix(line.find('"') + 1);
  return line.substr(0, line.find('"'));
}

void append_file(std::string& out, std::string_view name, std::set<std::string>& seen) {
  const auto mark = [&](int line) {
    out.append("#line ").append(std::to_string(line)).append(" \"").append(name).append("\"\n");
  };
  const std::string text = read(name);
  std::string_view rest = text;
  mark(1);
  for (int number = 1; !rest.empty(); ++number) {
    const std::string_view line = next_line(rest);
    if (line.starts_with("#include \"")) {
      const std::string_view file = quoted(line);
      if (seen.emplace(file).second) append_file(out, file, seen);
      mark(number + 1);
    } else {
      out.append(line).append("\n");
    }
  }
}

/// "file:line" of a line (from 1) of a source, by the `#line` directive before it.
std::string location_of(std::size_t line, std::string_view source) {
  constexpr std::string_view directive = "#line ";
  std::string_view file;
  std::size_t number = 0;
  for (std::size_t k = 0; k < line && !source.empty(); ++k) {
    const std::string_view text = next_line(source);
    ++number;
    if (!text.starts_with(directive)) continue;
    std::from_chars(text.data() + directive.size(), text.data() + text.size(), number);
    --number;
    file = quoted(text);
  }
  return std::string(file) + ":" + std::to_string(number);
}

}  // namespace

std::string with_file_names(const std::string& log, const std::string& source) {
  constexpr std::string_view mark = "<kernel>:";
  std::string result;
  std::size_t done = 0;
  for (std::size_t at = log.find(mark); at != std::string::npos; at = log.find(mark, done)) {
    const std::size_t digits = at + mark.size();
    const std::size_t end = log.find_first_not_of("0123456789", digits);
    if (end == digits || end == std::string::npos) break;
    std::size_t line = 0;
    const bool is_line = std::from_chars(log.data() + digits, log.data() + end, line).ec == std::errc();
    result += log.substr(done, at - done) + (is_line ? location_of(line, source) : log.substr(at, end - at));
    done = end;
  }
  return result + log.substr(done);
}

std::string kernel_source(std::string_view name) {
  std::string source;
  std::set<std::string> seen;
  append_file(source, std::string(name), seen);
  return source;
}

}  // namespace broadcl::opencl
