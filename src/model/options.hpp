// All options of an identification in one table. The library's checks, the text in files, the tool and Python read and
// write options by this table.
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
  std::string value = {};               // placeholder of the value in the help, such as "N|auto"
  std::string range = {};               // numbers that are allowed; empty: no number
  std::vector<std::string> words = {};  // words that are allowed
  std::string help = {};
  std::string opposite = {};  // help of the opposite, for an option that is on or off; else empty

  std::function<Json(const IdentifyOptions&)> write = {};
  std::function<bool(IdentifyOptions&, const Json&)> read = {};  // false: the value is not allowed

  bool is_switch() const { return !opposite.empty(); }
  // "a whole number from 1 to 1000000 or 'auto'", with `quote` around words.
  std::string needed(std::string_view quote = "") const;
};

const std::vector<Option>& option_table();
// Null if no option has this key.
const Option* find_option(std::string_view key);

// Converts a penalty λ to JSON. λ may be infinite, but JSON has no number for infinity.
Json penalty(double smoothing);
std::optional<double> penalty(const Json& value);  // empty: the value is not a penalty

// \throws std::invalid_argument that names the first option whose value is out of its range
void check_options(const IdentifyOptions& options);

}  // namespace tokid
