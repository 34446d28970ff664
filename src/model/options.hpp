// The options of an identification in one table. The library's checks, the text in files, the tool and Python all read
// and write options by it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/json.hpp"
#include "tokid/options.hpp"

namespace tokid {

struct Option {
  std::string key = {};                 // "hold_out"; the tool writes hyphens
  std::string value = {};               // placeholder of the value in a help, such as "N|auto"
  std::string range = {};               // numbers that it takes; empty: none
  std::vector<std::string> words = {};  // words that it takes
  std::string help = {};
  std::string opposite = {};  // help of the opposite of an option that is on or off; else empty

  std::function<Json(const IdentifyOptions&)> write = {};
  std::function<bool(IdentifyOptions&, const Json&)> read = {};  // false: the value is none that it takes

  bool is_switch() const { return !opposite.empty(); }
  // "a whole number from 1 to 1000000 or 'auto'", with these marks around words.
  std::string needed(std::string_view quote = "") const;
};

const std::vector<Option>& option_table();
// Null where there is none of that key.
const Option* find_option(std::string_view key);

// Conversion of a penalty λ. It may be infinite, and JSON has no infinity.
Json penalty(double smoothing);
std::optional<double> penalty(const Json& value);  // empty: the value is not a penalty

// \throws std::invalid_argument that names the first option whose value is out of its range
void check_options(const IdentifyOptions& options);

}  // namespace tokid
