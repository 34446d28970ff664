// Predictions of held-out experiments, several steps ahead → how many times larger their errors are than the model says.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Sums of squared errors, relative to the variances that a model gives them.
struct AheadErrors {
  Vector square;    // (m) of the errors
  Vector expected;  // (m) variances of the model at the same samples

  AheadErrors& operator+=(const AheadErrors& other);
  // Root of square / expected: geometric mean over the outputs with noise. NaN if there is none.
  double ratio() const;
};

// `predicted`: y_k from the outputs before step k - H + 1 (H = `horizon`). In innovation form, the error of the model is
//   e_k + C_k Σ_{k-H < j < k} A_{k-1} ⋯ A_{j+1} K_j e_j ,   K_j = -G_j, cov e_j = innovation_cov.
// The steps from `first` + H on count.
AheadErrors ahead_errors(const Model& model, const Ensemble& predicted, const Ensemble& measured, Index horizon,
                         Index first);

}  // namespace tokid
