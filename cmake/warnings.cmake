# Link it PRIVATE, so that these warnings do not apply to consumers.
add_library(broadcl_warnings INTERFACE)
if(MSVC)
  target_compile_options(broadcl_warnings INTERFACE /W4 $<$<BOOL:${BROADCL_WERROR}>:/WX>)
else()
  # GCC 12 reports overlapping copies in std::string that do not exist (GCC bug 105651).
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(broadcl_warnings INTERFACE -Wno-restrict)
  endif()
  # No -ffast-math, whatever CMAKE_CXX_FLAGS say, since comparisons with NaN must work; no fused multiply-add, so that
  # scenes are the same on every machine.
  target_compile_options(broadcl_warnings INTERFACE
    -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wold-style-cast -Wnon-virtual-dtor
    -Woverloaded-virtual -Wdouble-promotion -fno-fast-math -ffp-contract=off $<$<BOOL:${BROADCL_WERROR}>:-Werror>)
endif()
