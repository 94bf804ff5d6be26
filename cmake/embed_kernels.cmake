# cmake -D FILES=a.cl;b.h -D OUTPUT=embedded_kernels.cpp -P embed_kernels.cmake
# Writes a source file that contains the bytes of each file.
set(arrays "")
set(rows "")
set(number 0)
foreach(path IN LISTS FILES)
  get_filename_component(name ${path} NAME)
  file(READ ${path} hex HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1', " bytes "${hex}")
  string(APPEND arrays "constexpr char file_${number}[] = {${bytes}'\\0'};\n")
  string(APPEND rows "    KernelFile{\"${name}\", {file_${number}, sizeof(file_${number}) - 1}},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE ${OUTPUT} "// Generated from kernels/ by cmake/embed_kernels.cmake.
#include <array>

#include \"opencl/kernel_source.hpp\"

namespace broadcl::opencl {
namespace {

${arrays}
constexpr std::array files{
${rows}};

}  // namespace

std::span<const KernelFile> embedded_kernel_files() noexcept { return files; }

}  // namespace broadcl::opencl
")
