// Where a model comes from, in the JSON of Model::options beside the options of the identification.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "base/json.hpp"
#include "tokid/provenance.hpp"

namespace tokid::provenance {

inline constexpr const char *experiments_key = "experiments", *data_key = "data", *choices_key = "choices",
                            *refined_key = "refined", *dt_key = "dt_stated";
// Is it one of these, rather than an option?
bool is_key(std::string_view key);

// What the model holds, or an empty object.
Json of(const Model& model);

// A penalty λ, which may be infinite, as JSON has none.
Json penalty(double smoothing);
std::optional<double> penalty(const Json& value);  // nothing: not a penalty

}  // namespace tokid::provenance
