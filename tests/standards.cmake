# cmake -D COMPILER=c++ -D HEADERS=host -D INCLUDE_FOLDERS=... -P standards.cmake
# Which standard of C++ the public headers need: the adapter's are C++17, and each other one fails with a single error that
# says so; the adapter refuses a Bullet that is too old.
file(MAKE_DIRECTORY standards)
function(compile text)
  file(WRITE standards/file.cpp "${text}")
  execute_process(
    COMMAND ${COMPILER} -std=c++17 -Wall -Wextra -pedantic -fsyntax-only -I${HEADERS} -isystem ${BULLET} standards/file.cpp
    RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  string(REGEX MATCHALL "error:" errors "${output}")
  list(LENGTH errors errors)
  set(errors ${errors} PARENT_SCOPE)
  set(output "${output}" PARENT_SCOPE)
endfunction()
find_path(BULLET LinearMath/btScalar.h PATHS ${INCLUDE_FOLDERS} REQUIRED NO_DEFAULT_PATH)

set(cxx17 bullet.hpp config.hpp error.hpp)
foreach(header IN LISTS cxx17)
  compile("#include <broadcl/${header}>\n")
  if(output)
    message(FATAL_ERROR "broadcl/${header} is not C++17:\n${output}")
  endif()
endforeach()

file(GLOB headers RELATIVE ${HEADERS}/broadcl ${HEADERS}/broadcl/*.hpp)
list(REMOVE_ITEM headers ${cxx17})
foreach(header IN LISTS headers)
  compile("#include <broadcl/${header}>\n")
  if(NOT errors EQUAL 1 OR NOT output MATCHES "this header of BroadCL needs C\\+\\+20")
    message(FATAL_ERROR "broadcl/${header} should say in one error that it needs C++20:\n${output}")
  endif()
endforeach()

compile("#include <LinearMath/btScalar.h>\n#undef BT_BULLET_VERSION\n#define BT_BULLET_VERSION 289\n#include <broadcl/bullet.hpp>\n")
if(NOT output MATCHES "BroadCL needs Bullet 3.05 or later")
  message(FATAL_ERROR "broadcl/bullet.hpp should refuse Bullet 2.89:\n${output}")
endif()
