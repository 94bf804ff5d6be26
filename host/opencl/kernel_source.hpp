#pragma once

#include <span>
#include <string>
#include <string_view>

namespace broadcl::opencl {

/// A file of kernels/, byte for byte as it was when the library was built.
struct KernelFile {
  std::string_view name;
  std::string_view text;
};

/// Every embedded file. Defined by a source file that is generated at build time.
[[nodiscard]] std::span<const KernelFile> embedded_kernel_files() noexcept;

/// The text of a kernel file in which each file that it includes is inserted once. `#line` directives tell
/// compilers the file names and lines to report.
///
/// If BROADCL_KERNEL_DIR is set, files are read from the folder that it names, otherwise the embedded ones
/// are used.
/// @throws Error that names a file that cannot be found or read.
[[nodiscard]] std::string kernel_source(std::string_view name);

/// A compiler's log with file names and their lines. NVIDIA's compiler ignores `#line`: it reports
/// "<kernel>:LINE:" with the line in the whole source.
[[nodiscard]] std::string with_file_names(const std::string& log, const std::string& source);

}  // namespace broadcl::opencl
