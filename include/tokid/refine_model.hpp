// refine() with a chosen λ, and a comparison of the models before and after.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/em.hpp"
#include "tokid/validate.hpp"

namespace tokid {

struct RefineModelOptions {
  std::optional<double> smoothing = {};  // λ; empty: the λ of the identification, else by cross-validation
  std::optional<bool> feedthrough = {};  // false: D = 0 is known; empty: as the model was identified
  RefineOptions refine = {};             // its `smoothing` is ignored, its `feedthrough` must be true
};

// The fits of one model on the data of the refinement.
struct RefinementFigures {
  Fit simulation, one_step;  // over the samples that both models can compute
  double whiteness_p = 0.0;
};

struct RefinedModel {
  Refinement refinement;  // Refinement::model stores the fingerprint of the data, λ and the iterations
  double smoothing = 0.0;
  std::string reason;       // reason for this λ
  LikelihoodChoice choice;  // filled if λ was chosen by cross-validation
  RefinementFigures before, after;
  Findings findings;  // findings about differences between model and data, then findings of the refinement
};

// \throws as refine()
RefinedModel refine_model(const Model& model, const Ensemble& data, const RefineModelOptions& options = {});

}  // namespace tokid
