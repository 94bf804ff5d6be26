# cmake -D BUILD=build-tree -D SOURCE=examples -D COMPILE=ON|OFF -P consume_sources.cmake
# Projects of which BroadCL is a part: they get the library and nothing else. Compiling it takes a minute each.
include(${CMAKE_CURRENT_LIST_DIR}/projects.cmake)

set(folder ${BUILD}/consumer-sources)
file(REMOVE_RECURSE ${folder})
configure(part consume/add_subdirectory -D CMAKE_CXX_FLAGS=-O0)
file(STRINGS ${folder}/part/CMakeCache.txt entries REGEX "^[A-Za-z]")
list(FILTER entries EXCLUDE REGEX
  "^(CMAKE_|BROADCL_|broadcl_|consumer_|OpenCL_|OPENCL_|FIND_PACKAGE_|EXECUTABLE_|LIBRARY_)")
if(entries)
  message(FATAL_ERROR "add_subdirectory() leaves more than its own in the cache: ${entries}")
endif()
file(STRINGS ${folder}/part/CMakeCache.txt type REGEX "^CMAKE_BUILD_TYPE:[A-Z]*=.")
if(type)
  message(FATAL_ERROR "add_subdirectory() chooses the type of build: ${type}")
endif()
run(${CMAKE_COMMAND} --install ${folder}/part --prefix ${folder}/prefix)
if(EXISTS ${folder}/prefix)
  message(FATAL_ERROR "add_subdirectory() installs something")
endif()
configure(fetched consume/fetch_content -D CMAKE_CXX_FLAGS=-O0 -D BROADCL_INSTALL=ON)
# With a Bullet that is a part of the project, too.
make_other_bullet()
configure(vendored consume/vendored_bullet -D BULLET_SOURCE_DIR=${folder}/other-bullet -D CMAKE_EXPORT_COMPILE_COMMANDS=ON)
file(READ ${folder}/vendored/compile_commands.json commands)
string(FIND "${commands}" "${folder}/other-bullet/src " own)
string(FIND "${commands}" "${BULLET_HEADERS} " systems)
if(own EQUAL -1 OR NOT systems EQUAL -1)
  message(FATAL_ERROR "BroadCL is not compiled with the project's own Bullet:\n${commands}")
endif()
if(NOT COMPILE)
  return()
endif()
build(part consumer)
build(fetched consumer bullet_consumer)

# What the latter has made are static libraries, and they were to be installed.
set(prefix ${folder}/static)
run(${CMAKE_COMMAND} --build ${folder}/fetched)
run(${CMAKE_COMMAND} --install ${folder}/fetched --prefix ${prefix})
set(ENV{CMAKE_PREFIX_PATH} ${prefix})
configure(static consume/find_package -D WITH_BULLET=ON)
build(static consumer bullet_consumer)
expect_refused("component c: BroadCL is a static library of C++ here; add CXX to the languages of your project"
  ${CMAKE_COMMAND} -S ${SOURCE}/consume/c -B ${folder}/c)
make_with_pkg_config(${prefix})

# A plug-in that contains them can be unloaded.
configure(plugin ../tests/plugin)
run(${CMAKE_COMMAND} --build ${folder}/plugin)
run(sh -c "cc -shared -fPIC plugin.c -Wl,--version-script=plugin.map -o ${folder}/plugin/by_pkg_config.so \
  $(pkg-config --cflags --libs broadcl)" WORKING_DIRECTORY ${SOURCE}/../tests/plugin)
foreach(plugin libplugin by_pkg_config)
  run(${folder}/plugin/plugin_host ${folder}/plugin/${plugin}.so)
endforeach()
