# cmake --install: headers, library, tool, functions for MATLAB and Octave, licence, and the package files that find_package(tokid) reads.
# Component runtime: what programs need that run. Component development: what programs need that are built.
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/tokid)

install(TARGETS tokid EXPORT tokid
  LIBRARY COMPONENT runtime NAMELINK_COMPONENT development
  ARCHIVE COMPONENT development
  FILE_SET HEADERS COMPONENT development)
install(EXPORT tokid NAMESPACE tokid:: FILE tokidTargets.cmake DESTINATION ${package_dir} COMPONENT development)
if(TOKID_BUILD_TOOL)
  install(TARGETS tokid_tool COMPONENT runtime)
endif()
if(TARGET tokid_mpi)
  install(TARGETS tokid_mpi COMPONENT runtime)
endif()

get_target_property(library_type tokid TYPE)
configure_package_config_file(cmake/tokidConfig.cmake.in tokidConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(tokidConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tokidConfig.cmake ${PROJECT_BINARY_DIR}/tokidConfigVersion.cmake
        DESTINATION ${package_dir} COMPONENT development)
if(library_type STREQUAL STATIC_LIBRARY)
  install(FILES cmake/FindTokidFormats.cmake DESTINATION ${package_dir} COMPONENT development)
endif()

install(DIRECTORY matlab/ DESTINATION ${CMAKE_INSTALL_DATADIR}/tokid/matlab COMPONENT runtime)
install(FILES LICENSE NOTICE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)
