// The origin of a model, as Model::options stores it next to the options.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "tokid/model.hpp"

namespace tokid {

// Stores the fingerprint of the data; has_seen() tells whether the model stores that of these data.
void note_data(Model& model, const std::string& fingerprint);
bool has_seen(const Model& model, const Ensemble& data);
// Stores λ and the iterations of the last refinement.
void note_refinement(Model& model, double smoothing, Index iterations);
std::optional<double> refinement_smoothing(const Model& model);
// Stores the present number of experiments, and removes the note of a refinement.
void note_update(Model& model, Index experiments);
// Stores that the data stated no sample time.
void note_missing_dt(Model& model);
bool states_dt(const Model& model);

}  // namespace tokid
