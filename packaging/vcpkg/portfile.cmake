# (docs/releasing.md names what replaces OWNER and the checksum.)
vcpkg_from_github(
  OUT_SOURCE_PATH SOURCE_PATH
  REPO OWNER/broadcl
  REF "v${VERSION}"
  SHA512 0
  HEAD_REF main)
vcpkg_check_features(
  OUT_FEATURE_OPTIONS feature_options
  FEATURES
    bullet BROADCL_BULLET
    mpi BROADCL_MPI
    program BROADCL_PROGRAM)
vcpkg_cmake_configure(
  SOURCE_PATH "${SOURCE_PATH}"
  OPTIONS ${feature_options} -DBROADCL_BULLET_FLOAT64=OFF)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/broadcl)
vcpkg_fixup_pkgconfig()
if("program" IN_LIST FEATURES)
  vcpkg_copy_tools(TOOL_NAMES broadcl AUTO_CLEAN)
endif()
file(REMOVE_RECURSE
  "${CURRENT_PACKAGES_DIR}/debug/include" "${CURRENT_PACKAGES_DIR}/debug/share" "${CURRENT_PACKAGES_DIR}/share/doc")
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE")
