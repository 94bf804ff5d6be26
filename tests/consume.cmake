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

configure(examples .)
set(examples first pairs two_sets worlds layouts on_device bullet_world bullet_async ghost_objects moving_boxes)
if(FLOAT64)
  list(APPEND examples double_precision)
endif()
build(examples ${examples})
run(${folder}/examples/first)
if(NOT output STREQUAL "0 and 1 overlap\n")
  message(FATAL_ERROR "first: ${output}")
endif()

# The core alone, as on a machine without Bullet, OpenCL's headers and pkg-config's files.
set(without_bullet -D CMAKE_DISABLE_FIND_PACKAGE_Bullet=ON -D PKG_CONFIG_EXECUTABLE=/nonexistent)
configure(core consume/find_package ${without_bullet} -D CMAKE_DISABLE_FIND_PACKAGE_OpenCL=ON)
build(core consumer)
expect_refused("component bullet: Bullet (float32) was found neither by pkg-config"
  ${CMAKE_COMMAND} ${folder}/core -D WITH_BULLET=ON)
# Bullet by its own CMake package.
configure(bullet consume/find_package -D WITH_BULLET=ON -D PKG_CONFIG_EXECUTABLE=/nonexistent)
build(bullet bullet_consumer)
configure(c consume/c)
build(c consumer)

if(MPIEXEC)
  # Open MPI has more ranks than processors, and perhaps root, by these.
  set(ENV{OMPI_ALLOW_RUN_AS_ROOT} 1)
  set(ENV{OMPI_ALLOW_RUN_AS_ROOT_CONFIRM} 1)
  set(ENV{OMPI_MCA_rmaps_base_oversubscribe} 1)
  run(${CMAKE_COMMAND} --build ${folder}/examples --target mpi)
  run(${MPIEXEC} -n 3 ${folder}/examples/mpi --objects 3000 --frames 4 --check)
  message(STATUS "mpi: ${output}")
  run(${CMAKE_COMMAND} -E chdir ${folder} ${prefix}/bin/broadcl simulate --scenario agitated --objects 300 --frames 6
    --broadphase sweep-and-prune --record trace.aabbs)
  run(${MPIEXEC} -n 2 ${folder}/examples/mpi --trace ${folder}/trace.aabbs --placement random --check)
  message(STATUS "mpi: ${output}")
  configure(mpi consume/mpi)
  run(${CMAKE_COMMAND} --build ${folder}/mpi)
  run(${MPIEXEC} -n 3 ${folder}/mpi/mpi_consumer)
  message(STATUS "mpi_consumer: ${output}")
endif()

make_with_pkg_config(${prefix})
