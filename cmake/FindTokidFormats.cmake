# The C libraries that read and write the file formats: HDF5, libzip, matio, libcsv and zlib, as one target
# TokidFormats::TokidFormats. Used to build tokid, and installed with a static tokid, whose consumers link them too.
include(FindPackageHandleStandardArgs)

set(_formats_variables)
# name, header, directories below the include path, library names
foreach(_format "HDF5|hdf5.h|hdf5/serial|hdf5_serial,hdf5" "libzip|zip.h||zip" "matio|matio.h||matio" "libcsv|csv.h||csv"
        "zlib|zlib.h||z")
  string(REPLACE "|" ";" _format "${_format}")
  list(GET _format 0 _name)
  list(GET _format 1 _header)
  list(GET _format 2 _suffix)
  list(GET _format 3 _libraries)
  string(REPLACE "," ";" _libraries "${_libraries}")

  find_path(TokidFormats_${_name}_INCLUDE_DIR ${_header} PATH_SUFFIXES ${_suffix})
  find_library(TokidFormats_${_name}_LIBRARY NAMES ${_libraries})
  mark_as_advanced(TokidFormats_${_name}_INCLUDE_DIR TokidFormats_${_name}_LIBRARY)
  list(APPEND _formats_variables TokidFormats_${_name}_INCLUDE_DIR TokidFormats_${_name}_LIBRARY)
endforeach()

find_package_handle_standard_args(TokidFormats REQUIRED_VARS ${_formats_variables}
  REASON_FAILURE_MESSAGE "On Debian: libhdf5-dev libzip-dev libmatio-dev libcsv-dev zlib1g-dev")

if(TokidFormats_FOUND AND NOT TARGET TokidFormats::TokidFormats)
  add_library(TokidFormats::TokidFormats INTERFACE IMPORTED)
  foreach(_variable ${_formats_variables})
    if(_variable MATCHES "_INCLUDE_DIR$")
      target_include_directories(TokidFormats::TokidFormats INTERFACE ${${_variable}})
    endif()
  endforeach()
  # A static library stands before those that it needs: matio needs HDF5, and both need zlib, as libzip does.
  foreach(_name matio HDF5 libzip libcsv zlib)
    target_link_libraries(TokidFormats::TokidFormats INTERFACE ${TokidFormats_${_name}_LIBRARY})
  endforeach()
endif()
