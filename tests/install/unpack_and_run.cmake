# cmake -Dconfiguration= -Dfolder= -P unpack_and_run.cmake: the archive that CPack makes has a tool that runs.
cmake_minimum_required(VERSION 3.25)
file(REMOVE_RECURSE ${folder})
execute_process(COMMAND ${CMAKE_CPACK_COMMAND} --config ${configuration} -G TGZ -B ${folder}/made COMMAND_ERROR_IS_FATAL ANY)
file(GLOB archive ${folder}/made/*.tar.gz)
file(ARCHIVE_EXTRACT INPUT ${archive} DESTINATION ${folder}/unpacked)
file(REMOVE_RECURSE ${folder}/made)
file(GLOB tool ${folder}/unpacked/*/bin/tokid)
execute_process(COMMAND ${tool} --version COMMAND_ERROR_IS_FATAL ANY)
