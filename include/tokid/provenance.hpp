// What Model::options remembers beside the options: where the model comes from.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "tokid/model.hpp"

namespace tokid {

// The data, by their fingerprints.
void note_data(Model& model, const std::string& fingerprint);
bool has_seen(const Model& model, const Ensemble& data);
// λ and the iterations of the last refinement.
void note_refinement(Model& model, double smoothing, Index iterations);
std::optional<double> refinement_smoothing(const Model& model);
// So many experiments by now, and no refinement of them.
void note_update(Model& model, Index experiments);
// The data stated no sample time.
void note_missing_dt(Model& model);
bool states_dt(const Model& model);

}  // namespace tokid
