# cmake -D BUILD=build-tree -D SOURCE=examples -D FLOAT64=ON|OFF -D MPIEXEC=|mpiexec -P consume.cmake
# Installs a build into a new folder, then builds projects against what was installed, each in its own way, and runs their
# programs.
include(${CMAKE_CURRENT_LIST_DIR}/projects.cmake)

set(folder ${BUILD}/consumer)
set(prefix ${folder}/prefix)
file(REMOVE_RECURSE ${folder})
set(ENV{CMAKE_PREFIX_PATH} ${prefix})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${prefix})
run(${prefix}/bin/broadcl --version)
run(${CMAKE_CURRENT_LIST_DIR}/completion.sh ${prefix}/bin/broadcl ${prefix}/share/bash-completion/completions/broadcl)

configure(examples .)
set(examples first pairs queries distances rays going_back two_sets what_may_pair worlds layouts on_device bullet_world bullet_async
  ghost_objects moving_boxes)
if(FLOAT64)
  list(APPEND examples double_precision)
endif()
build(examples ${examples})

# The core alone, as on a machine without Bullet, OpenCL's headers and pkg-config's files.
set(without_bullet -D CMAKE_DISABLE_FIND_PACKAGE_Bullet=ON -D PKG_CONFIG_EXECUTABLE=/nonexistent)
configure(core consume/find_package ${without_bullet} -D CMAKE_DISABLE_FIND_PACKAGE_OpenCL=ON)
build(core consumer)
expect_refused("component bullet: Bullet (float32) was found neither by its CMake package nor by pkg-config"
  ${CMAKE_COMMAND} ${folder}/core -D WITH_BULLET=ON)
# Bullet by its own CMake package, then by pkg-config.
configure(bullet consume/find_package -D WITH_BULLET=ON -D PKG_CONFIG_EXECUTABLE=/nonexistent)
build(bullet bullet_consumer)
configure(bullet-pkg-config consume/find_package -D WITH_BULLET=ON -D CMAKE_DISABLE_FIND_PACKAGE_Bullet=ON)
build(bullet-pkg-config bullet_consumer)
# Another component has to be asked for, in the folder that links to it or above.
file(WRITE ${folder}/unasked/CMakeLists.txt "cmake_minimum_required(VERSION 3.22)
project(unasked LANGUAGES CXX)
find_package(broadcl REQUIRED)
add_subdirectory(asks)
add_subdirectory(does_not)
")
file(WRITE ${folder}/unasked/asks/CMakeLists.txt "find_package(broadcl REQUIRED COMPONENTS bullet)
add_library(asks INTERFACE)
target_link_libraries(asks INTERFACE broadcl::bullet)
")
file(WRITE ${folder}/unasked/does_not/CMakeLists.txt "file(WRITE empty.cpp)
add_library(private STATIC empty.cpp)
target_link_libraries(private PRIVATE \${PRIVATE})
add_library(interface INTERFACE)
target_link_libraries(interface INTERFACE \${INTERFACE})
")
set(unasked ${CMAKE_COMMAND} -S ${folder}/unasked -B ${folder}/unasked/build)
run(${unasked})
foreach(scope PRIVATE INTERFACE)
  string(TOLOWER ${scope} target)
  expect_refused(
    "${target} links to broadcl::bullet, for which you have to write find_package(broadcl REQUIRED COMPONENTS bullet)"
    ${unasked} -D PRIVATE=broadcl::broadcl -D INTERFACE=broadcl::broadcl -D ${scope}=broadcl::bullet)
endforeach()
# A project's own Bullet comes before that of the system: its targets, and the package that it names.
make_other_bullet()
configure(own-targets ../tests/other_bullet -D BULLET_SOURCE_DIR=${folder}/other-bullet)
run(${CMAKE_COMMAND} --build ${folder}/own-targets --verbose)
if(output MATCHES "-lBulletCollision|libBulletCollision\\.so")
  message(FATAL_ERROR "the system's Bullet is linked beside the project's own:\n${output}")
endif()
build(own-targets other_bullet)
configure(own-package ../tests/other_bullet -D Bullet_DIR=${folder}/other-bullet/cmake)
build(own-package other_bullet)
expect_refused("component bullet: Bullet (float32) is needed, but the project's targets BulletCollision and LinearMath are float64"
  ${CMAKE_COMMAND} ${folder}/own-targets -D USE_DOUBLE_PRECISION=ON)
configure(c consume/c)
build(c consumer)

if(MPIEXEC)
  # Open MPI has more ranks than processors, and perhaps root, by these.
  set(ENV{OMPI_ALLOW_RUN_AS_ROOT} 1)
  set(ENV{OMPI_ALLOW_RUN_AS_ROOT_CONFIRM} 1)
  set(ENV{OMPI_MCA_rmaps_base_oversubscribe} 1)
  # Ranks print in any order.
  set(ENV{LC_ALL} C)
  run(${CMAKE_COMMAND} --build ${folder}/examples --target mpi)
  run(sh -c "${MPIEXEC} -n 3 ${folder}/examples/mpi | sort")
  expect_output(mpi)
  configure(mpi consume/mpi)
  run(${CMAKE_COMMAND} --build ${folder}/mpi)
  run(sh -c "${MPIEXEC} -n 3 ${folder}/mpi/mpi_consumer | sort")
  expect_output(mpi_consumer)
endif()

make_with_pkg_config(${prefix})
