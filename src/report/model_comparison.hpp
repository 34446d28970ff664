// Several models of the same channels on the same data, with fits over the same samples.
// A model that overflows has infinite errors from there on, and removes no sample from the others.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "report/origin.hpp"
#include "tokid/report.hpp"
#include "tokid/validate.hpp"

namespace tokid::report {

// The relation of the tested experiments to the identification of another model.
enum class Known { not_seen, held_out, training, partly };

struct ComparedModel {
  std::string name;
  Index states = 0;
  Known known = Known::not_seen;
  Fit simulation, one_step, ahead;
  Ensemble simulated;  // the whole simulation, also before the first common step
};
struct ModelComparison {
  Index horizon = 1;                  // H of `ahead`
  Index from = 0;                     // the first step at which every model has the outputs that it computes at all
  std::vector<ComparedModel> models;  // the model of the page first; empty without other models
};
// Compares options.compare with the model. Fits have the samples that every model computes, and the nominal trajectory
// of the model of the page. A model that computes no sample of a kind has no such fit (samples = 0), and the others are
// compared without it. `whole`: the data that were given. \throws std::invalid_argument for another number of
// channels, which the message names with the model
ModelComparison compare_models(const Model& model, const Ensemble& whole, const Tested& tested);

}  // namespace tokid::report
