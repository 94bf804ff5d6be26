# cmake -D BUILD=build-tree -D SOURCE=examples -D FLOAT64=ON|OFF -P consume.cmake
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
set(examples pairs two_sets worlds layouts on_device bullet_world bullet_async ghost_objects moving_boxes)
if(FLOAT64)
  list(APPEND examples double_precision)
endif()
build(examples ${examples})

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

make_with_pkg_config(${prefix})
