# Warnings for the project's own targets, as errors where tokid is the top project (cmake
# --compile-no-warning-as-error lifts that). Consumers and the headers of dependencies are left alone.
function(tokid_warnings target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow)
  set_target_properties(${target} PROPERTIES COMPILE_WARNING_AS_ERROR ${PROJECT_IS_TOP_LEVEL})
endfunction()
