# cmake -D BUILD=build-tree -D SOURCE=project -P consume.cmake
# Installs a build into a new folder, then builds the project against what was installed and runs its programs.
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(failed)
    message(FATAL_ERROR "${ARGV}\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

set(folder ${BUILD}/consumer)
file(REMOVE_RECURSE ${folder})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${folder}/prefix)
run(${CMAKE_COMMAND} -S ${SOURCE} -B ${folder}/build -D CMAKE_PREFIX_PATH=${folder}/prefix
  -D CMAKE_CXX_FLAGS=-Werror)
run(${CMAKE_COMMAND} --build ${folder}/build)
foreach(example pairs layouts on_device bullet_world bullet_async)
  run(${folder}/build/${example})
  message(STATUS "${example}: ${output}")
endforeach()
run(${folder}/prefix/bin/broadcl --version)
