# A script of CPack, run on the staged files: what Debian wants in its packages beside them.
cmake_policy(VERSION 3.25)
if(NOT CPACK_GENERATOR STREQUAL DEB)
  return()
endif()
find_program(GZIP gzip REQUIRED)
find_program(HELP2MAN help2man REQUIRED)
set(stage ${CPACK_TEMPORARY_INSTALL_DIRECTORY})
set(tool ${stage}/runtime/usr/bin/tokid)
set(manuals ${stage}/runtime/usr/share/man/man1)

function(write_compressed file content)
  file(WRITE ${file} "${content}")
  execute_process(COMMAND ${GZIP} --best --no-name ${file} COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# A manual page for the tool, and one for each of its commands, from what they print with --help.
function(write_manual command summary)
  execute_process(
    COMMAND ${HELP2MAN} --no-info --name=${summary} --version-string=${CPACK_PACKAGE_VERSION} "${tool} ${command}"
    OUTPUT_VARIABLE manual COMMAND_ERROR_IS_FATAL ANY)
  string(STRIP "tokid ${command}" words)
  string(REPLACE " " "-" page ${words})
  string(TOUPPER ${page} title)
  string(REPLACE ".TH TOKID " ".TH ${title} " manual "${manual}")
  string(REPLACE "\n${words} \\-" "\n${page} \\-" manual "${manual}")
  write_compressed(${manuals}/${page}.1 "${manual}")
endfunction()

execute_process(COMMAND ${tool} --help OUTPUT_VARIABLE help COMMAND_ERROR_IS_FATAL ANY)
write_manual("" ${CPACK_PACKAGE_DESCRIPTION_SUMMARY})
# A description may take several lines.
string(REGEX REPLACE "\n   +" " " help "${help}")
string(REGEX MATCH "Commands:\n(  [^\n]*\n)+" commands "${help}")
string(REGEX MATCHALL "\n  [^\n]*" commands "${commands}")
foreach(line ${commands})
  string(REGEX MATCH "^\n  ([^ ]+) +([^\n]*)" line "${line}")
  write_manual("${CMAKE_MATCH_1}" "${CMAKE_MATCH_2}")
endforeach()

# Debian's libraries are found without, whatever folder the tool is in.
file(RPATH_REMOVE FILE ${tool})

# One changelog is ours, the other that of the packaging.
file(READ ${CPACK_TOKID_SOURCE_DIR}/CHANGELOG.md changelog)
set(debian_version ${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
set(debian_changelog "tokid (${debian_version}) stable; urgency=medium

  * Made of tokid ${CPACK_PACKAGE_VERSION} with CPack.

 -- ${CPACK_DEBIAN_PACKAGE_MAINTAINER}  ${date}
")

file(READ ${CPACK_TOKID_SOURCE_DIR}/LICENSE license)
file(READ ${CPACK_TOKID_SOURCE_DIR}/NOTICE notice)
file(REMOVE ${stage}/runtime/usr/share/doc/tokid/LICENSE ${stage}/runtime/usr/share/doc/tokid/NOTICE)

foreach(documents ${stage}/runtime/usr/share/doc/tokid ${stage}/development/usr/share/doc/libtokid-dev)
  file(WRITE ${documents}/copyright "${license}\n${notice}")
  write_compressed(${documents}/changelog "${changelog}")
  write_compressed(${documents}/changelog.Debian "${debian_changelog}")
endforeach()
