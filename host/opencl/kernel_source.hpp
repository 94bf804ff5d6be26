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

/// The text of a kernel file with the files that it includes put in place, each once. `#line` directives keep
/// file names and lines, so that compilers report where an error really is.
///
/// Files are read from the folder that BROADCL_KERNEL_DIR names where that is set, else the embedded ones are
/// used.
/// @throws Error naming the file that cannot be found or read.
[[nodiscard]] std::string kernel_source(std::string_view name);

/// A compiler's log in which places are named by file and line. NVIDIA's compiler does not heed `#line`: it
/// reports
/// "<kernel>:LINE:" with the line of the whole source.
[[nodiscard]] std::string with_file_names(const std::string& log, const std::string& source);

}  // namespace broadcl::opencl
