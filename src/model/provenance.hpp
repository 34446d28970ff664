// The origin of a model, in the JSON of Model::options next to the options of the identification.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>

#include "base/json.hpp"
#include "tokid/provenance.hpp"

namespace tokid::provenance {

inline constexpr const char *experiments_key = "experiments", *data_key = "data", *choices_key = "choices",
                            *refined_key = "refined", *dt_key = "dt_stated";
// Is this key one of the above, and not an option?
bool is_key(std::string_view key);

// The JSON of the model, or an empty object.
Json of(const Model& model);

// Conversion of a penalty λ. It may be infinite, and JSON has no infinity.
Json penalty(double smoothing);
std::optional<double> penalty(const Json& value);  // empty: the value is not a penalty

}  // namespace tokid::provenance
