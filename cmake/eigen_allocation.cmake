# How Eigen allocates matrices follows from the instruction set and the sanitizers, and matrices pass through tokid's
# API. version.hpp records what the library is compiled for: a consumer compiled for something else is refused by the
# compiler instead of crashing when it frees what the library allocated.
if(NOT DEFINED TOKID_EIGEN_ALLOCATION)
  set(source ${PROJECT_BINARY_DIR}/CMakeFiles/eigen_allocation.cpp)
  set(binary ${PROJECT_BINARY_DIR}/CMakeFiles/eigen_allocation.bin)
  file(WRITE ${source} [[
#include <Eigen/Core>
#define TEXT(x) #x
#define VALUE(x) TEXT(x)
const char text[] = "eigen allocation:" VALUE(EIGEN_DEFAULT_ALIGN_BYTES) "," VALUE(EIGEN_MALLOC_ALREADY_ALIGNED);
int main(int argc, char**) { return text[argc]; }
]])
  set(CMAKE_TRY_COMPILE_CONFIGURATION ${CMAKE_BUILD_TYPE})
  try_compile(compiled ${PROJECT_BINARY_DIR}/CMakeFiles SOURCES ${source} LINK_LIBRARIES Eigen3::Eigen
              OUTPUT_VARIABLE output COPY_FILE ${binary})
  unset(CMAKE_TRY_COMPILE_CONFIGURATION)
  if(compiled)
    file(STRINGS ${binary} found REGEX "eigen allocation:[0-9]+,[01]" LIMIT_COUNT 1)
  endif()
  if(NOT found MATCHES "eigen allocation:([0-9]+),([01])")
    message(FATAL_ERROR "Could not compile with Eigen:\n${output}")
  endif()
  set(TOKID_EIGEN_ALLOCATION ${CMAKE_MATCH_1} ${CMAKE_MATCH_2} CACHE INTERNAL "")
endif()
list(GET TOKID_EIGEN_ALLOCATION 0 TOKID_EIGEN_ALIGN_BYTES)
list(GET TOKID_EIGEN_ALLOCATION 1 TOKID_EIGEN_PLAIN_MALLOC)
