// JSON from untrusted text. The reader and the writer are compiled once, in json.cpp.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace tokid {

using Json = nlohmann::ordered_json;  // keys keep the order in which they were written

// Returns a discarded value if the text is not JSON.
Json parse_json(std::string_view text);

// Writes JSON on one line, or indented by `indent` spaces; invalid UTF-8 is replaced.
std::string text_of(const Json& json, int indent = -1);

constexpr std::size_t longest_options = std::size_t{1} << 24, deepest_options = 16, most_options = 1024;

struct JsonMeasure {
  std::size_t depth = 0, keys = 0;
};

// Measures the depth and the number of keys by the brackets and colons outside strings. The text need not be JSON.
JsonMeasure measure_json(std::string_view text);

// False for a text that is far larger or deeper than any identification writes. JSON values are copied and written by
// recursion, so a deep text would exhaust the stack. Keys of an ordered object are searched one by one, so a text with
// many keys would take very long.
bool is_modest(std::string_view options);

// Parses the text of a provenance. Returns a discarded value if the text is not JSON or not modest.
Json options_json(const std::string& options);

}  // namespace tokid
