#include "opencl/kernel_source.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include <broadcl/error.hpp>

#include "system.hpp"

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

/// The file that an `#include "..."` line names.
std::optional<std::string> included_file(std::string_view line) {
  constexpr std::string_view prefix = "#include \"";
  if (!line.starts_with(prefix)) return std::nullopt;
  line.remove_prefix(prefix.size());
  return std::string(line.substr(0, line.find('"')));
}

void append_file(std::string& out, const std::string& name, std::set<std::string>& seen) {
  const auto mark = [&](int line) { out += "#line " + std::to_string(line) + " \"" + name + "\"\n"; };
  std::istringstream lines(read(name));
  mark(1);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (const auto file = included_file(line)) {
      if (seen.insert(*file).second) append_file(out, *file, seen);
      mark(number + 1);
    } else {
      out += line + '\n';
    }
  }
}

/// "file:line" of a line (from 1) of a source, by the `#line` directive before it.
std::string location_of(std::size_t line, const std::string& source) {
  std::istringstream lines(source);
  std::string file;
  std::size_t number = 0;
  std::string text;
  for (std::size_t k = 0; k < line && std::getline(lines, text); ++k) {
    ++number;
    std::istringstream words(text);
    std::string directive;
    if (words >> directive && directive == "#line") {
      words >> number >> std::quoted(file);
      --number;
    }
  }
  return file + ":" + std::to_string(number);
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
    result += log.substr(done, at - done) + location_of(std::stoul(log.substr(digits, end - digits)), source);
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
