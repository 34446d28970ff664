# cpack: one .tar.gz that runs wherever it is unpacked, and two packages for Debian, tokid and libtokid-dev.
set(CPACK_PACKAGE_VENDOR "the tokid authors")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "identification of linear time-varying systems")
set(CPACK_PACKAGE_FILE_NAME ${PROJECT_NAME}-${PROJECT_VERSION}-linux-${CMAKE_SYSTEM_PROCESSOR})
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL runtime development)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/debian_files.cmake)
set(CPACK_TOKID_SOURCE_DIR ${PROJECT_SOURCE_DIR})

# Who makes the packages answers for them, as with Debian's own tools; a name under .invalid is nobody's (RFC 2606).
if(DEFINED ENV{DEBEMAIL} AND DEFINED ENV{DEBFULLNAME})
  set(CPACK_DEBIAN_PACKAGE_MAINTAINER "$ENV{DEBFULLNAME} <$ENV{DEBEMAIL}>")
else()
  set(CPACK_DEBIAN_PACKAGE_MAINTAINER "the tokid authors <nobody@tokid.invalid>")
endif()

set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY ">=")

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME tokid)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
file(WRITE ${PROJECT_BINARY_DIR}/debian/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA ${PROJECT_BINARY_DIR}/debian/triggers)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS octave)
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION
"From an ensemble of repeated experiments on a linear time-varying system,
tokid identifies the state-space matrices of every step together with the
gains of an observer, by the time-varying observer/Kalman filter
identification (TOKID) of Majji, Juang and Junkins. It validates models,
simulates and predicts with them, and plans experiments.
.
This package has the command line tool, the shared library, and functions
for MATLAB and Octave.")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libtokid-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "tokid (= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}), libeigen3-dev (>= 3.4)")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION
"Headers of the C++20 library that the command line tool tokid is made of,
and what find_package(tokid) of CMake reads.")

include(CPack)
