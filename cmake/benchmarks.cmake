# Every bench/*.cpp is one Google Benchmark program.
find_package(benchmark REQUIRED)
file(GLOB benchmark_sources CONFIGURE_DEPENDS bench/*.cpp)
foreach(source ${benchmark_sources})
  cmake_path(GET source STEM name)
  add_executable(${name} ${source})
  target_link_libraries(${name} PRIVATE tokid::tokid benchmark::benchmark_main)
  tokid_warnings(${name})
endforeach()
