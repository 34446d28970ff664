// JSON as text, without trust in where it comes from. To read and to write it is compiled once, in json.cpp.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace tokid {

using Json = nlohmann::ordered_json;  // keys stay in the order in which they were written

// Discarded where the text is no JSON.
Json parse_json(std::string_view text);

// On one line, or indented by some spaces; what is no UTF-8 is replaced.
std::string text_of(const Json& json, int indent = -1);

constexpr std::size_t longest_options = std::size_t{1} << 24, deepest_options = 16, most_options = 1024;

struct JsonMeasure {
  std::size_t depth = 0, keys = 0;
};

// Of any text: brackets and colons that are not within a string.
JsonMeasure measure_json(std::string_view text);

// Copies and texts of a JSON value are made by recursion, and the keys of an ordered object are searched one by one: a
// text that is far deeper than any identification writes would take the stack, and one of many keys forever.
bool is_modest(std::string_view options);

// Model::options; discarded where the text is no JSON, or not modest.
Json options_json(const std::string& options);

}  // namespace tokid
