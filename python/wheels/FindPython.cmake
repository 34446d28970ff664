# The headers of a Python that does not run here, as find_package(Python) gives them. Python_EXECUTABLE is another one,
# which runs nanobind. Given: Python_INCLUDE_DIRS, Python_VERSION, Python_SOABI.
add_executable(Python::Interpreter IMPORTED)
set_target_properties(Python::Interpreter PROPERTIES IMPORTED_LOCATION ${Python_EXECUTABLE})
foreach(module Module SABIModule)
  add_library(Python::${module} INTERFACE IMPORTED)
  target_include_directories(Python::${module} INTERFACE ${Python_INCLUDE_DIRS})
endforeach()
set(Python_INTERPRETER_ID Python)
set(Python_FOUND TRUE)
