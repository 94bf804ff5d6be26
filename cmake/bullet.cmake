# broadcl_find_bullet(float32|float64): makes the target BroadclBullet::float32 or ::float64, the Bullet of that precision,
# unless there is one. It is found by pkg-config, otherwise by the CMake package that Bullet installs.
# broadcl_bullet_missing_<precision>: empty, or what is missing.
# Part of the installed package, too.
function(broadcl_find_bullet precision)
  set(target BroadclBullet::${precision})
  set(missing broadcl_bullet_missing_${precision})
  set(${missing} "" PARENT_SCOPE)
  if(TARGET ${target})
    return()
  endif()

  set(module bullet)
  if(precision STREQUAL float64)
    set(module bullet-float64)
  endif()
  find_package(PkgConfig QUIET)
  if(PKG_CONFIG_FOUND)
    pkg_check_modules(broadcl_${module} QUIET IMPORTED_TARGET GLOBAL ${module})
    if(broadcl_${module}_FOUND)
      add_library(${target} INTERFACE IMPORTED GLOBAL)
      target_link_libraries(${target} INTERFACE PkgConfig::broadcl_${module})
      return()
    endif()
  endif()

  find_package(Bullet CONFIG QUIET)
  set(found float32)
  if(BULLET_DEFINITIONS MATCHES BT_USE_DOUBLE_PRECISION)
    set(found float64)
  endif()
  if(Bullet_FOUND AND found STREQUAL precision)
    # Its paths may be relative to its root.
    foreach(list INCLUDE_DIRS LIBRARY_DIRS)
      set(${list} "")
      foreach(folder IN LISTS BULLET_${list})
        cmake_path(ABSOLUTE_PATH folder BASE_DIRECTORY "${BULLET_ROOT_DIR}")
        list(APPEND ${list} "${folder}")
      endforeach()
    endforeach()
    separate_arguments(definitions UNIX_COMMAND "${BULLET_DEFINITIONS}")
    add_library(${target} INTERFACE IMPORTED GLOBAL)
    target_include_directories(${target} INTERFACE ${INCLUDE_DIRS})
    target_link_directories(${target} INTERFACE ${LIBRARY_DIRS})
    # Not BULLET_LIBRARIES, which may name some that are not installed.
    target_link_libraries(${target} INTERFACE BulletSoftBody BulletDynamics BulletCollision LinearMath)
    target_compile_options(${target} INTERFACE ${definitions})
    return()
  endif()
  set(${missing}
    "Bullet (${precision}) was found neither by pkg-config, as '${module}', nor by its CMake package; install it (Debian: libbullet-dev) or name its folder in CMAKE_PREFIX_PATH"
    PARENT_SCOPE)
endfunction()
