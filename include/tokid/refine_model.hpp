// refine() with its λ chosen, and what became of the model by it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/em.hpp"
#include "tokid/validate.hpp"

namespace tokid {

struct RefineModelOptions {
  std::optional<double> smoothing = {};  // λ; empty: that of the identification, else by cross-validation
  RefineOptions refine = {};             // of which `smoothing` is of no account
};

// Of one model on the data of its refinement.
struct RefinementFigures {
  Fit simulation, one_step;  // over the samples that both models can compute
  double whiteness_p = 0.0;
};

struct RefinedModel {
  Refinement refinement;  // its model has noted data, λ and iterations
  double smoothing = 0.0;
  std::string reason;       // for this λ
  LikelihoodChoice choice;  // filled where it was chosen by cross-validation
  RefinementFigures before, after;
  Findings findings;  // those of the refinement, after the differences of model and data
};

// \throws as refine()
RefinedModel refine_model(const Model& model, const Ensemble& data, const RefineModelOptions& options = {});

}  // namespace tokid
