# What consume.cmake and consume_sources.cmake have in common. SOURCE is the folder of the examples, `folder` one to build in.
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(failed)
    message(FATAL_ERROR "${ARGV}\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

# Whether a command fails with an error that has this text. (CMake breaks lines.)
function(expect_refused text)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  string(REGEX REPLACE "[ \n]+" " " output "${output}")
  string(FIND "${output}" "${text}" position)
  if(NOT failed OR position EQUAL -1)
    message(FATAL_ERROR "${ARGN}\nshould fail with '${text}':\n${output}")
  endif()
endfunction()

function(run_programs folder)
  foreach(program IN LISTS ARGN)
    run(${folder}/${program})
    message(STATUS "${program}: ${output}")
  endforeach()
endfunction()

# configure(name project ...), build(name program ...): a project, and its programs, which are run.
function(configure name project)
  run(${CMAKE_COMMAND} -S ${SOURCE}/${project} -B ${folder}/${name}
    -D CMAKE_CXX_FLAGS=-Werror "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror -pedantic" ${ARGN})
endfunction()
function(build name)
  run(${CMAKE_COMMAND} --build ${folder}/${name} --target ${ARGN})
  run_programs(${folder}/${name} ${ARGN})
endfunction()

# The project for pkg-config, with what is installed there.
function(make_with_pkg_config prefix)
  run(${CMAKE_COMMAND} -E copy_directory ${SOURCE}/consume ${folder}/consume)
  file(GLOB pkg_config_files ${prefix}/lib*/pkgconfig ${prefix}/lib/*/pkgconfig)
  cmake_path(GET pkg_config_files PARENT_PATH libraries)
  run(${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${pkg_config_files} make -C ${folder}/consume/pkg_config BULLET=1
    CXXFLAGS=-Werror "CFLAGS=-Wall -Wextra -Werror -pedantic" LDFLAGS=-Wl,-rpath,${libraries})
  run_programs(${folder}/consume/pkg_config consumer c_consumer bullet_consumer)
endfunction()
