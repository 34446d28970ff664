# Warnings for the project's own targets. TOKID_WARNINGS_AS_ERRORS makes them errors: a compiler that the project does not
# know yet may warn of correct code, and must still build tokid for its users. Consumers and the headers of dependencies
# are left alone.
function(tokid_warnings target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow)
  set_target_properties(${target} PROPERTIES COMPILE_WARNING_AS_ERROR ${TOKID_WARNINGS_AS_ERRORS})
endfunction()
