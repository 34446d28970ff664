// The bootstrap of a function of an identified model, with the bias of smoothing over time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/options.hpp"
#include "uncertainty/replicate.hpp"
#include "uncertainty/smoothing_bias.hpp"

namespace tokid::uncertainty {

// The experiments that the identification used, as they were measured. \throws std::invalid_argument if `data` is not
// the ensemble of the identification
Ensemble training_part(const Model& model, const Ensemble& data, const IdentifyOptions& identification);

// A finding if the model was identified from other samples.
Findings findings_of_data(const Model& model, const Ensemble& training);

struct Replication {
  Bootstrap bootstrap;     // its intervals include the bias
  Vector scatter;          // standard errors without the bias
  Vector bias_squares;     // empty without a bias
  double smoothing = 0.0;  // λ whose bias is included; 0: none
  Findings findings;
};
// `places`: the entries of the function that belong to steps; the bias is averaged over neighbouring steps. Uses level,
// replicates, seed and execution of the options. \throws as bootstrap()
Replication replicate(const Model& model, const Ensemble& training, const IdentifyOptions& identification,
                      const Functional& functional, const std::vector<PerStep>& places,
                      const ConfidenceOptions& options, Care care = Care::usual);

}  // namespace tokid::uncertainty
