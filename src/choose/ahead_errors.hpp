// Predictions of held-out experiments, several steps ahead → how large their errors are, and what they come from.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/choices.hpp"
#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Sums over the same samples, for each output (m). Outputs without noise have zeros.
struct AheadErrors {
  Vector square;    // of the errors
  Vector expected;  // variances that the model gives them
  Vector spread;    // variances of the predictions over the models that other experiments would give

  AheadErrors& operator+=(const AheadErrors& other);
  // Root of square / expected: geometric mean over the outputs with noise. NaN if there is none.
  double ratio() const;
  // Share of the variance of the errors that comes from the model, 0 to 1: mean over the outputs with noise. Errors
  // that the models of all folds share are not in it. NaN if no output has noise.
  double model_share() const;
};

// `predicted`: y_k from the outputs before step k - H + 1 (H = `horizon`). In innovation form, the error of the model
// is
//   e_k + C_k Σ_{k-H < j < k} A_{k-1} ⋯ A_{j+1} K_j e_j ,   K_j = -G_j, cov e_j = innovation_cov.
// `by_others`: the same by models of other folds, of `folds` in total, which have seen these experiments. The spread is
// that of the jackknife. The steps from the first one of the model + H on count.
AheadErrors ahead_errors(const Model& model, const Ensemble& predicted, const std::vector<Ensemble>& by_others,
                         Index folds, const Ensemble& measured, Index horizon);

// The certainty of the models of folds, of `folds` in total. `held_out`: the experiments that each model has not seen
AheadCertainty ahead_certainty(const std::vector<Model>& models, const std::vector<const Ensemble*>& held_out,
                               Index folds, InitialState initial, int threads);

}  // namespace tokid
