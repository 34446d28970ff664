# tokid_embed(target function=file ...): the bytes of each file, as `std::string_view function()` in namespace
# tokid::report::assets. A change of a file compiles its bytes anew.
function(tokid_embed target)
  set(output ${PROJECT_BINARY_DIR}/${target}_assets.cpp)
  set(files)
  foreach(entry ${ARGN})
    string(REGEX REPLACE "^[a-z_]+=" "" file ${entry})
    list(APPEND files ${PROJECT_SOURCE_DIR}/${file})
  endforeach()
  set(script ${PROJECT_SOURCE_DIR}/cmake/embed_files.cmake)
  add_custom_command(OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} "-Dentries=${ARGN}" -Dsource=${PROJECT_SOURCE_DIR} -Doutput=${output} -P ${script}
    DEPENDS ${files} ${script}
    COMMENT "Embedding the assets of ${target}"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
endfunction()
