// A validation with the outputs that it judged, for those who show them: they cost most of its time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/validate.hpp"

namespace tokid {

struct Judged {
  Validation validation;
  Prediction prediction;  // one step ahead
  Ensemble simulated;     // simulate_data()
};
// \throws as validate(), which returns the first of the three
Judged judge(const Model& model, const Ensemble& data, const ValidateOptions& options);

// validate() without words on outlying samples, for those who know the data that these are a part of.
Validation validate_in_numbers(const Model& model, const Ensemble& data, const ValidateOptions& options);

}  // namespace tokid
