# cmake -Dsource= -Dbinary= -Doptions= -P build_and_run.cmake: configures, builds and tests a project from scratch.
cmake_minimum_required(VERSION 3.25)
file(REMOVE_RECURSE ${binary})
execute_process(COMMAND ${CMAKE_COMMAND} -S ${source} -B ${binary} ${options} COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${binary} COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_CTEST_COMMAND} --test-dir ${binary} --output-on-failure --no-tests=error
                COMMAND_ERROR_IS_FATAL ANY)
