#include "opencl/kernel_source.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>

#include <broadcl/error.hpp>

#include "system.hpp"

namespace broadcl::opencl {
namespace {

std::string read(std::string_view name) {
  if (const auto folder = environment("BROADCL_KERNEL_DIR")) {
    const auto path = std::filesystem::path(*folder) / name;
    std::ifstream file(path, std::ios::binary);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    if (!file) {
      throw Error("cannot read " + path.string() +
                  "; point BROADCL_KERNEL_DIR to the folder with BroadCL's kernels, or unset it");
    }
    return text;
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

void append(std::string& out, const std::string& name, std::set<std::string>& seen) {
  const auto mark = [&](int line) { out += "#line " + std::to_string(line) + " \"" + name + "\"\n"; };
  std::istringstream lines(read(name));
  mark(1);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (const auto file = included_file(line)) {
      if (seen.insert(*file).second) append(out, *file, seen);
      mark(number + 1);
    } else {
      out += line + '\n';
    }
  }
}

}  // namespace

std::string kernel_source(std::string_view name) {
  std::string source;
  std::set<std::string> seen;
  append(source, std::string(name), seen);
  return source;
}

}  // namespace broadcl::opencl
