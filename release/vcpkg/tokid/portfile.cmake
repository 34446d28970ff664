# An overlay port of this source tree: vcpkg install tokid --overlay-ports=release/vcpkg
# In the registry of vcpkg, vcpkg_from_github() with the tag of the release takes the place of SOURCE_PATH.
get_filename_component(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

vcpkg_check_features(OUT_FEATURE_OPTIONS features FEATURES tool TOKID_BUILD_TOOL)
vcpkg_cmake_configure(
  SOURCE_PATH "${SOURCE_PATH}"
  OPTIONS ${features} -DTOKID_BUILD_EXAMPLES=OFF -DTOKID_BUILD_TESTS=OFF -DTOKID_BUILD_PYTHON=OFF -DTOKID_WITH_MPI=OFF)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/tokid)
if("tool" IN_LIST FEATURES)
  vcpkg_copy_tools(TOOL_NAMES tokid AUTO_CLEAN)
endif()
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/debug/include" "${CURRENT_PACKAGES_DIR}/debug/share")
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE" "${SOURCE_PATH}/NOTICE")
