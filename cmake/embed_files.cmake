# Run by the build, see embed.cmake. Bytes in rows of numbers are what every compiler takes, at any length.
set(text "// Made by cmake/embed_files.cmake\n#include \"report/assets.hpp\"\n\nnamespace tokid::report::assets {\n")
foreach(entry ${entries})
  string(REGEX MATCH "^([a-z_]+)=(.+)$" matched ${entry})
  set(name ${CMAKE_MATCH_1})
  file(READ ${source}/${CMAKE_MATCH_2} bytes HEX)
  string(REGEX REPLACE "(................................)" "\\1\n" bytes "${bytes}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(APPEND text "\nstatic const unsigned char ${name}_bytes[] = {\n${bytes}0};\n"
                     "std::string_view ${name}() {\n"
                     "  return {reinterpret_cast<const char*>(${name}_bytes), sizeof(${name}_bytes) - 1};\n}\n")
endforeach()
file(WRITE ${output} "${text}\n}  // namespace tokid::report::assets\n")
