# cmake -Dsource= -Dbinary= -Doptions= -Dreason= -P refuse.cmake: configuring or building must fail, for that reason.
cmake_minimum_required(VERSION 3.25)
file(REMOVE_RECURSE ${binary})
execute_process(COMMAND ${CMAKE_COMMAND} -S ${source} -B ${binary} ${options}
                RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
if(status EQUAL 0)
  execute_process(COMMAND ${CMAKE_COMMAND} --build ${binary}
                  RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
endif()
string(REGEX REPLACE "[ \n]+" " " words "${output}")
if(status EQUAL 0)
  message(FATAL_ERROR "should have been refused:\n${output}")
elseif(NOT words MATCHES "${reason}")
  message(FATAL_ERROR "refused, but not for '${reason}':\n${output}")
endif()
message("refused as it should be:\n${output}")
